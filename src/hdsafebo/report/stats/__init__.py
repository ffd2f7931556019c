"""Intervals, paired tests, calibration and regret."""

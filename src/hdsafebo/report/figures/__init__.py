"""Figures in one style: grids of panels as files, single panels on the page."""

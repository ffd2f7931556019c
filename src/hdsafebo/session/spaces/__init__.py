"""What each kind of session says about its inputs: names, units, hard limits, how a point is read and shown.

Hard limits are checked by `Space.breaches`, before and after any model.
"""

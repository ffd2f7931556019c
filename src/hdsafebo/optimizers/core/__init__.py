"""Behind ask and tell: the ledger of trials, checks of results, proposals, fits, saved states.

Nothing here knows a method; a method overrides nothing here.
"""

"""Where to look: the searched box and its metric, candidates, trust regions, ascents, acquisition functions.

Parts that several methods share. They know processes (`gp`) and no method.
"""

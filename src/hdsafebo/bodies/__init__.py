"""Whole musculoskeletal bodies that stay up after a push: model, environment, posture and reflexes.

Knows nothing of optimisation. `environment.py` is what Gymnasium makes; `posture.py` linearises the body at
the posture that it stands in, and `reflex.py` builds stretch and balance reflexes from that.
"""

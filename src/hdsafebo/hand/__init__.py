"""The musculoskeletal hand: model, environment, policies, rollouts, training and synergies.

Importing this package registers the environment `hdsafebo/BottleHand-v0` with Gymnasium.
"""

import gymnasium

if "hdsafebo/BottleHand-v0" not in gymnasium.registry:
    gymnasium.register(id="hdsafebo/BottleHand-v0", entry_point="hdsafebo.hand.environment:BottleHandEnv")

"""SAC agents on the hand, and the muscle activations of their rollouts."""

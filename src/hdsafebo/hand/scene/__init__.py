"""The scene: the hand with its muscles, the bottle, and the pose in which an episode starts."""

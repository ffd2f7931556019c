"""Pictures and videos of MuJoCo simulations, drawn off screen; knows no model and no task."""

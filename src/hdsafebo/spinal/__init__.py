"""The spinal cord: finite-element model, muscle activation, stimulation set, field maps."""

"""A simulated patient, and a month of trials with one."""

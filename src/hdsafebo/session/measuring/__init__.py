"""From what was measured to outcomes: recordings, EMG windows, tables, the stimulator's units."""

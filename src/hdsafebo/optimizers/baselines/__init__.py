"""Published methods, a file per paper, each read like the pseudo-code of its paper."""

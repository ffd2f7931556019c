"""Campaigns: runs of (task, method, seed), resumable, in parallel, mirrored to a tracking server."""

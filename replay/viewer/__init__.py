"""Rerun recordings of replays and logs, and the viewer that shows them."""

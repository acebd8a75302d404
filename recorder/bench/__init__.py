"""Ground truth at the bench: floor coordinates, waypoints, and the keys that mark them."""

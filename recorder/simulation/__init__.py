"""The simulated camera: what a real one would see of markers at known places."""

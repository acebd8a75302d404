"""What is recorded, seen and tracked while it comes in."""

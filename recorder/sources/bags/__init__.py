"""ROS bags: other people's recordings as a source."""

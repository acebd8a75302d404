"""Cameras that do not wait: V4L2 devices, RTSP and HTTP MJPEG streams."""

"""Recordings in other formats become datasets: CSV with any columns, ROS 1 and ROS 2 bags."""

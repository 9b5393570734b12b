"""The operator's console: access, command, views and the page; without ROS."""

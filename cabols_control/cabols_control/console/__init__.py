"""The operator's console: who may do what, what is shown, and the page; no ROS in here."""

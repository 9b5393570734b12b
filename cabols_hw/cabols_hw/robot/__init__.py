"""What the rig asks of any robot, whoever made it."""

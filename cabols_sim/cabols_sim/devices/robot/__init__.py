"""The simulated robot: kinematics, flexible joints, smooth motions, the plant's target."""

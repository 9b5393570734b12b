"""From a desired tension to a motor current, limb by limb."""

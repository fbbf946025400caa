"""From scans along a trajectory to a map: point cloud, strips against each other, terrain, objects, error budget."""

"""What vehicle and camera wrote down, or are described by: wheels, velocities, headings, paths."""

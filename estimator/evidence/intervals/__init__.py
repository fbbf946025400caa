"""When something acts: onsets and intervals of offsets, sudden changes, wrong readings one by one."""

"""Exact regions of any smooth condition, their images, and the workspaces of mechanisms: geometry on top of mechanics.

`regions` (a region of a plane, its boundary as closed polygons), `overlay` (images of regions, and how they overlap),
`singularity` and `aspects` (curves, cusps and nodes of det J = 0, and paths that avoid it) know no mechanism;
`workspace` (cable-driven mechanisms), `accessibility` (the 2-X) and `four_bar_workspace` apply them. `obstacle_path` is
the shortest path past a round obstacle. Modules are imported one by one: some need shapely, which is slow to import.
"""

"""Files of surfaces: OBJ, PLY, STL, glTF, COLLADA, X3D, VRML, ASE."""

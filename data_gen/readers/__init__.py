"""Reading models from files: OBJ, MTL, AC3D and the formats of Pyrogenesis here, others by trimesh.

Nothing outside of the `files.Files` handed over is opened, and what is read is bounded: bytes of a
file, faces (counted before they are built wherever the format permits), pixels decoded and kept.
"""

"""Maps of other programs become world folders: readers, one intermediate scene, one builder.

Every reader yields a `scene.Scene`; `builder` turns it into meshes, collision pieces, `scene.xml`
and `world.toml` (worlds reference 11).
"""

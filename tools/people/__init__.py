"""Makes the virtual people of rehearsals: glTF files from MakeHuman's base mesh (public domain).

`base_mesh` reads the mesh, its body shapes, bones and skinning weights; `wardrobe` dresses a body; `motion`
makes it walk, stand and sit; `gltf` writes the file; `cast` lists the people that ship.
"""

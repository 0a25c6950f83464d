"""Strong models that a user brings as ONNX files: numpy, OpenCV and onnxruntime, no framework.

`catalogue.open_model` is the way in. A family is one module that turns its graph's outputs into the roles of
`perception.roles`; files, sidecars, pictures and boxes are each read in one place. No robot, no camera, no
policy.
"""

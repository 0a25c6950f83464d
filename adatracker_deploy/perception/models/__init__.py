"""User-provided models as ONNX files; needs only numpy, OpenCV and onnxruntime.

`catalogue.open_model` is the entry point. Each model family is one module that maps its graph's outputs to
the roles of `perception.roles`; files, sidecars, images and boxes are each handled in one place. No robot, no
camera, no policy.
"""

"""Conversion of the shipped perception models: TensorFlow.js to ONNX, folded, named, quantised, indexed.

What is here needs numpy, onnx and, to quantise, onnxruntime and OpenCV, but no TensorFlow. Nothing here is
imported by the toolkit; `tools/convert_perception.py` puts the steps in order.
"""

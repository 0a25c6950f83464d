"""The perception models that are shipped, as ONNX.

`models.yaml` says of each what it is, its inputs and outputs, SHA-256 and how it was made
(`tools/convert_perception.py`); `NOTICE` says whose work they are and under which licences.
"""

"""Turn a checkpoint into a policy bundle; the same as ``adatracker-deploy export-onnx``.

python tools/export_onnx.py CHECKPOINT --out DIR
"""

import sys

from adatracker_deploy.cli import main

if __name__ == "__main__":
    sys.exit(main(["export-onnx", *sys.argv[1:]]))

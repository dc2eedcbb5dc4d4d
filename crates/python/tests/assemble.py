"""Lays the package out as its wheel does, around a library that cargo has built, and prints what the package depends on:
`assemble.py LIBRARY FOLDER`."""

import pathlib
import shutil
import sys
import tomllib

library, folder = (pathlib.Path(argument) for argument in sys.argv[1:])
source = pathlib.Path(__file__).parents[1]
project = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["project"]

shutil.rmtree(folder, ignore_errors=True)
shutil.copytree(source / "python/texfold", folder / "texfold", ignore=shutil.ignore_patterns("__pycache__"))
shutil.copy(library, folder / "texfold/_texfold.so")
about = folder / "texfold-0.dist-info"
about.mkdir()
(about / "METADATA").write_text("Metadata-Version: 2.1\nName: texfold\nVersion: 0\n", encoding="utf-8")
with open(about / "entry_points.txt", "w", encoding="utf-8") as out:
    for group, points in project["entry-points"].items():
        print(f"[{group}]", *(f"{name} = {place}" for name, place in points.items()), sep="\n", file=out)

print(*project["dependencies"], *(name for extra in project["optional-dependencies"].values() for name in extra), sep="\n")

"""Print the oldest versions that pyproject.toml allows: name>=X or name[extra]>=X as name==X."""

import re
import tomllib
from pathlib import Path

text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
project = tomllib.loads(text)["project"]
for needs in project["dependencies"], *project["optional-dependencies"].values():
    for need in needs:
        print(re.sub(r"(\[\w+\])?>=", "==", need))

"""The types of the page's and the workbench's modules, checked by TypeScript from their comments."""

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "build_web.sh"


@pytest.mark.soak
def test_typescript_finds_no_fault_in_the_modules():
    missing = [name for name in ("node", "npm", "npx") if shutil.which(name) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} missing: Debian packages nodejs and npm")
    if subprocess.run(["npm", "view", "typescript", "version"], capture_output=True, check=False).returncode:
        pytest.skip("npm reaches no registry")
    checked = subprocess.run(["bash", str(SCRIPT), "check"], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout

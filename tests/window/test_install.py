"""Blender's own command line with the built zip: installed and enabled, listed, removed."""

import os
import subprocess

import pytest

pytestmark = pytest.mark.window


def test_the_program_installs_and_removes_it(blender, extension_zip, tmp_path):
    own = tmp_path / "resources"
    own.mkdir()

    def extension(*arguments: str) -> str:
        ended = subprocess.run(
            [blender, "--command", "extension", *arguments],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"BLENDER_USER_RESOURCES": str(own)},
        )
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    extension("install-file", "-r", "user_default", "--enable", str(extension_zip))
    assert "oneframe [installed]" in extension("list")
    assert list(own.rglob("cv2")) != []
    extension("remove", "oneframe")
    assert "oneframe" not in extension("list")
    assert not (own / "extensions" / "user_default" / "oneframe").exists()
    assert list(own.rglob("cv2")) == []

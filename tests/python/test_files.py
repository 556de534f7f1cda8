"""Reading and writing: only regular files, whole or not at all, attributes as before."""

from __future__ import annotations

import gc
import os
import signal
import stat
import struct
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import veriray
from veriray import gallery, image
from veriray.cli import main
from veriray.errors import SceneError
from veriray.files import check_writable, open_regular, replacing
from veriray_bench.run import read as read_results


def write(path: Path, content: bytes = b"new") -> None:
    with replacing(path) as file:
        file.write(content)


@pytest.fixture
def pipe(tmp_path: Path) -> Iterator[Path]:
    os.mkfifo(tmp_path / "pipe.xml")
    signal.alarm(60)  # opening one the usual way waits for a writer
    yield tmp_path / "pipe.xml"
    signal.alarm(0)


# ---- reading ----


def test_pipes_are_refused_at_once(pipe: Path, tmp_path: Path) -> None:
    for read in (open_regular, image.load, read_results):
        with pytest.raises(OSError, match="not a regular file") as caught:
            read(pipe)
        assert caught.value.filename == str(pipe)
    with pytest.raises(SceneError, match="not a regular file"):
        veriray.load_file(pipe)
    assert main(["compare", str(pipe), str(pipe)]) == 2
    os.mkfifo(tmp_path / "studio.png")
    with pytest.raises(OSError, match="not a regular file"):
        gallery.run(output=tmp_path, sheet_only=True)


def test_folders_and_devices_are_refused(tmp_path: Path) -> None:
    for path, message in ((tmp_path, "Is a directory"), ("/dev/zero", "not a regular file")):
        with pytest.raises(OSError, match=message):
            open_regular(path)


def test_an_interrupt_while_opening_closes_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(status: os.stat_result, where: str) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "a"
    write(path)
    before = os.listdir("/proc/self/fd")
    monkeypatch.setattr("veriray.files._must_be_regular", interrupt)
    with pytest.raises(KeyboardInterrupt):
        open_regular(path)
    monkeypatch.undo()
    assert os.listdir("/proc/self/fd") == before
    with open_regular(path) as file:  # a second close would hit this one
        gc.collect()
        assert file.read() == b"new"


# ---- names ----


@pytest.mark.parametrize("end", ["/", "//", "/.", "/.."])
def test_a_slash_at_the_end_names_a_folder(tmp_path: Path, end: str) -> None:
    name = str(tmp_path / "x.exr") + end
    for check in (check_writable, write):
        with pytest.raises(OSError, match="names a folder, not a file") as caught:
            check(name)  # type: ignore[operator]
        assert caught.value.filename == name
    assert main(["render", "cornell-box", "-o", name]) == 2
    assert os.listdir(tmp_path) == []


def test_a_scene_with_a_slash_at_the_end(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="names a folder"):
        veriray.load_file(f"{tmp_path}/scene.xml/")


# ---- an overwritten file keeps its attributes ----


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o755])
def test_the_mode_stays(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    path.chmod(mode)
    with replacing(path) as file:
        assert stat.S_IMODE(os.fstat(file.fileno()).st_mode) == 0o600, "nobody else reads it"
        file.write(b"new")
    assert stat.S_IMODE(path.stat().st_mode) == mode and path.read_bytes() == b"new"


def test_a_new_file_obeys_the_umask(tmp_path: Path) -> None:
    old = os.umask(0o027)
    try:
        write(tmp_path / "x")
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "x").stat().st_mode) == 0o640


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_the_owner_stays(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    os.chown(path, 1234, 4321)
    write(path)
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 4321)


def give(path: Path, name: str, value: bytes) -> None:
    """Sets an extended attribute, or skips the test."""
    try:
        os.setxattr(path, name, value)
    except OSError as error:
        pytest.skip(f"the file system of {path} takes no {name}: {error.strerror}")


def access_list(user: int, rights: int, group: int) -> bytes:
    """As Linux keeps it: owner rw, that user `rights`, group `group`, at most rw, others none."""
    nobody = 2**32 - 1
    entries = [(1, 6, nobody), (2, rights, user), (4, group, nobody), (16, 6, nobody)]
    return struct.pack("<I", 2) + b"".join(
        struct.pack("<HHI", *entry) for entry in [*entries, (32, 0, nobody)]
    )


def test_extended_attributes_stay(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    give(path, "user.note", b"kept\0")
    path.chmod(0o400)
    write(path)
    assert os.getxattr(path, "user.note") == b"kept\0" and path.read_bytes() == b"new"


def test_access_control_lists_stay(tmp_path: Path) -> None:
    path, plain, name = tmp_path / "x", tmp_path / "plain", "system.posix_acl_access"
    for file in (path, plain):
        file.write_bytes(b"old")
        file.chmod(0o600)
    value = access_list(1234, 6, 0)
    give(path, name, value)
    write(path)
    assert os.getxattr(path, name) == value and stat.S_IMODE(path.stat().st_mode) == 0o660
    give(tmp_path, "system.posix_acl_default", value)  # of files made from now on
    write(path)
    write(plain)
    assert os.getxattr(path, name) == value
    assert name not in os.listxattr(plain) and stat.S_IMODE(plain.stat().st_mode) == 0o600


def test_no_group_gains_rights_where_a_list_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    give(path, "system.posix_acl_access", access_list(1234, 6, 0))

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "setxattr", refuse)
    write(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600 and path.read_bytes() == b"new"


def test_capabilities_do_not_pass_to_new_content(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    give(path, "security.capability", struct.pack("<5I", 0x02000001, 1 << 10, 0, 0, 0))
    write(path)
    assert "security.capability" not in os.listxattr(path)


def test_links_stay(tmp_path: Path) -> None:
    path, twin, link = (tmp_path / name for name in ("x", "twin", "link"))
    path.write_bytes(b"old, and longer")
    os.link(path, twin)
    link.symlink_to("x")
    write(link)
    assert link.is_symlink() and path.samefile(twin)
    assert path.read_bytes() == twin.read_bytes() == b"new"
    with pytest.raises(RuntimeError, match="stop"), replacing(path) as file:
        file.write(b"half")
        raise RuntimeError("stop")
    assert twin.read_bytes() == b"new"
    assert sorted(os.listdir(tmp_path)) == ["link", "twin", "x"]


# ---- leftovers of killed processes ----

WRITER = """
import sys, time
from veriray.files import replacing
with replacing(sys.argv[1]) as file:
    file.write(b"half")
    print("ready", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("name", ["x.exr", "n" * 250])
def test_the_next_write_removes_what_a_kill_left(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    other = tmp_path / f".{name[:200]}.mine.tmp"
    other.touch()
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        try:
            write(path)
            (left,) = set(os.listdir(tmp_path)) - {name, other.name}
            assert left.startswith(f".{name[:200]}.veriray-"), "of a living process: stays"
        finally:
            process.send_signal(signal.SIGKILL)
    check_writable(path)
    assert sorted(os.listdir(tmp_path)) == sorted([name, other.name])
    assert path.read_bytes() == b"new"


def test_writers_do_not_disturb_each_other(tmp_path: Path) -> None:
    path = tmp_path / "x"

    def repeat(k: int) -> None:
        for _ in range(50):
            check_writable(path)
            write(path, b"%d" % k * 5000)
            assert path.read_bytes() in contents

    contents = [b"%d" % k * 5000 for k in range(4)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(repeat, range(4)))
    assert os.listdir(tmp_path) == ["x"]

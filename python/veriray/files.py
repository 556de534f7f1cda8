"""Files: only regular files are read, and a written file appears whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

#: Of `read_files`.
_records: list[set[tuple[int, int]]] = []


@contextlib.contextmanager
def read_files() -> Iterator[Callable[[str | os.PathLike[str]], bool]]:
    """Tells of a path whether it is a file that `open_regular` opened in this block."""
    files: set[tuple[int, int]] = set()

    def has(path: str | os.PathLike[str]) -> bool:
        with contextlib.suppress(OSError):
            return _identity(os.stat(path)) in files
        return False

    _records.append(files)
    try:
        yield has
    finally:
        _records.remove(files)


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def open_regular(path: str | os.PathLike[str]) -> IO[bytes]:
    """A regular file opened for reading; anything else, even a pipe, raises OSError at once."""
    file = open(path, "rb", opener=_at_once)  # which owns the descriptor from the start
    try:
        status = os.fstat(file.fileno())
        _must_be_regular(status, os.fspath(path))
    except BaseException:
        file.close()
        raise
    for files in _records:
        files.add(_identity(status))
    return file


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)


def target_of(path: str | os.PathLike[str]) -> tuple[Path, os.stat_result | None]:
    """The file that writing to `path` replaces, links followed, and its status if it exists.

    Raises OSError naming `path` if no regular file can be there.
    """
    where = os.fspath(path)
    if os.path.basename(where) in ("", ".", ".."):
        raise OSError(errno.EISDIR, "names a folder, not a file", where)
    target = Path(os.path.realpath(where))
    try:
        status = os.stat(target)
    except FileNotFoundError:
        return target, None
    except OSError as error:
        raise OSError(error.errno, error.strerror, where) from None
    _must_be_regular(status, where)
    return target, status


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raises OSError naming `path` if `replacing` cannot write there; leaves nothing behind."""
    where = os.fspath(path)
    target, old = target_of(path)
    if old is not None and old.st_nlink > 1 and not os.access(target, os.W_OK):
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), where)
    if not target.parent.is_dir():
        reason = os.strerror(errno.ENOENT)
        raise OSError(errno.ENOENT, f"folder {target.parent}: {reason}", where)
    try:
        descriptor, temporary = _temporary(target, 0o600)
        try:
            os.unlink(temporary)
        finally:
            os.close(descriptor)  # last: an unlocked one may be removed by another writer
    except OSError as error:
        raise OSError(error.errno, f"folder not writable: {error.strerror}", where) from error


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A binary file that replaces `path` when the block ends without an exception.

    It is written beside `path`, flushed to the disk and renamed; on any failure it is removed and
    `path` stays as it was. Leftovers of a killed process are removed when `path` is written again.
    Links are followed; a target that is not a regular file is refused. A new file's mode follows
    the umask; an existing file keeps its mode and, where permitted, its owner, extended attributes
    and access control list (but not capabilities). A file with several hard links is overwritten in
    place once its new content is complete on the disk, so that all names see it: a kill during this
    copy can truncate it.
    """
    where = os.fspath(path)
    try:
        target, old = target_of(path)
        descriptor, temporary = _temporary(target, 0o666 if old is None else 0o600)
        try:
            with os.fdopen(descriptor, "w+b") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
                if old is not None and old.st_nlink > 1:
                    _copy_into(file, target)
                    os.unlink(temporary)
                else:
                    if old is not None:
                        _adopt(file.fileno(), old, target)
                    os.replace(temporary, target)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
        folder = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), where) from error


def _must_be_regular(status: os.stat_result, where: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), where)
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file", where)


def _temporary(target: Path, mode: int) -> tuple[int, Path]:
    """A new locked file ".NAME.veriray-XXXXXXXX.tmp" beside `target`: its descriptor and path.

    The kernel drops the lock when the process ends, however that happens. So a file of this name
    that can be locked belongs to a dead process, and is removed.
    """
    head = f".{os.fsdecode(os.fsencode(target.name)[:200])}.veriray-"  # names end at 255 bytes
    with contextlib.suppress(OSError):
        for name in os.listdir(target.parent):
            if name.startswith(head) and name.endswith(".tmp"):
                _remove_unlocked(target.with_name(name))
    while True:
        path = target.with_name(f"{head}{os.urandom(4).hex()}.tmp")
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return descriptor, path
        os.close(descriptor)  # removed as if stale before it was locked


def _remove_unlocked(path: Path) -> None:
    with contextlib.suppress(OSError), open_regular(path) as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.unlink(path)


def _adopt(descriptor: int, old: os.stat_result, target: Path) -> None:
    """Gives a file the mode of `target`, and where permitted owner, group and attributes."""
    for owner in (old.st_uid, -1):
        with contextlib.suppress(PermissionError):
            os.fchown(descriptor, owner, old.st_gid)
            break
    names = _attributes(target)
    lost = {_ACL} & {*names}
    if not lost:
        with contextlib.suppress(OSError):  # there is none, mostly: of the folder's default
            os.removexattr(descriptor, _ACL)
    for name in names:  # while the mode still lets the owner
        if name not in _OF_CONTENT:
            with contextlib.suppress(OSError):
                os.setxattr(descriptor, name, os.getxattr(target, name))
                lost -= {name}
    # beside a list the group's bits are the most that the list grants, and not the group's
    os.fchmod(descriptor, old.st_mode & (0o707 if lost else 0o777))


_ACL = "system.posix_acl_access"
#: Attributes that vouch for a file's content.
_OF_CONTENT = ("security.capability", "security.ima", "security.evm")


def _attributes(file: Path) -> list[str]:
    try:
        return os.listxattr(file)
    except OSError:  # a file system without
        return []


def _copy_into(file: IO[bytes], target: Path) -> None:
    """Overwrites `target` in place, after reserving the space on the disk."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    with open(target, "r+b") as out:
        os.posix_fallocate(out.fileno(), 0, max(size, 1))
        shutil.copyfileobj(file, out)
        out.truncate()
        out.flush()
        os.fsync(out.fileno())

"""Program that expands a xacro file in a process that may read files and print, and nothing else.

xacro evaluates Python expressions. It hides Python's functions from them, but an expression can find its way back to
those. Therefore the kernel refuses this process everything that a description does not need: other programs, other
processes, the network, and every change of a file. It is started with the path of the file and its arguments, each
``NAME:=VALUE``; it exits with 0 and the URDF on standard output, or with `FAILED` and the reason.
"""

import ctypes
import errno
import os
import platform
import resource
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from importlib import import_module
from types import CodeType
from typing import Any

CPU, MEMORY, OUTPUT = 4, 2**30, 2**24
"""Limits of the process: s, bytes, bytes."""
FAILED, UNCONFINED = 3, 4
"""Exit codes: the file cannot be expanded; this machine cannot confine the process."""

_COLUMNS = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}
"""By machine: its number in the kernel's audit, and its column in the table of calls."""
_CALLS = {
    "read": (0, 63),
    "write": (1, 64),
    "close": (3, 57),
    "stat": (4, None),
    "fstat": (5, 80),
    "lstat": (6, None),
    "lseek": (8, 62),
    "mmap": (9, 222),
    "mprotect": (10, 226),
    "munmap": (11, 215),
    "brk": (12, 214),
    "rt_sigaction": (13, 134),
    "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139),
    "pread64": (17, 67),
    "access": (21, None),
    "mremap": (25, 216),
    "madvise": (28, 233),
    "dup": (32, 23),
    "getpid": (39, 172),
    "exit": (60, 93),
    "uname": (63, 160),
    "getcwd": (79, 17),
    "readlink": (89, None),
    "getuid": (102, 174),
    "geteuid": (107, 175),
    "sigaltstack": (131, 132),
    "gettid": (186, 178),
    "futex": (202, 98),
    "getdents64": (217, 61),
    "clock_gettime": (228, 113),
    "exit_group": (231, 94),
    "newfstatat": (262, 79),
    "readlinkat": (267, 78),
    "faccessat": (269, 48),
    "getrandom": (318, 278),
    "statx": (332, 291),
    "faccessat2": (439, 439),
}
"""Calls that are allowed with any arguments."""
_OPEN = {"open": (2, None, 1), "openat": (257, 56, 2)}
"""Calls that are allowed only for reading, and the position of their flags."""
_IOCTL, _IS_TERMINAL = (16, 29), 0x5401
"""The call that finds whether a file is a terminal; it is allowed for nothing else."""
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

_IMPORTED_LATE = ("xacro.substitution_args", "yaml", "ament_index_python.packages")
"""Modules that xacro imports when it needs them; they are imported before, so that the limits are those of the file."""

# Of linux/filter.h and linux/seccomp.h.
_LOAD, _EQUAL, _ANY_BIT, _RETURN = 0x20, 0x15, 0x45, 0x06
_ALLOW, _REFUSE, _KILL = 0x7FFF0000, 0x00050000 | errno.EPERM, 0x80000000
_NUMBER, _MACHINE, _ARGUMENTS = 0, 4, 16  # positions of the number, the machine and the arguments, bytes
_NO_NEW_PRIVILEGES, _SECCOMP, _FILTER = 38, 22, 2


def confine() -> None:
    """Limit this process to reading files, for ever.

    Raises:
        OSError: the machine cannot.
    """
    for kind, limit in (
        (resource.RLIMIT_CPU, CPU),
        (resource.RLIMIT_AS, MEMORY),
        (resource.RLIMIT_FSIZE, OUTPUT),  # That of standard output; no other file can be written.
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (limit, limit))
    if platform.machine() not in _COLUMNS or sys.platform != "linux":
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    program = b"".join(_program(*_COLUMNS[platform.machine()]))
    code = ctypes.create_string_buffer(program)
    loaded = struct.pack("HP", len(program) // 8, ctypes.addressof(code))
    libc = ctypes.CDLL(None, use_errno=True)
    for arguments in ((_NO_NEW_PRIVILEGES, 1, 0), (_SECCOMP, _FILTER, loaded)):
        if libc.prctl(*(a if isinstance(a, bytes) else ctypes.c_ulong(a) for a in arguments), 0, 0) != 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _program(machine: int, column: int) -> list[bytes]:
    """The filter of `confine`: every call that it does not name is refused."""
    code = [_step(_LOAD, _MACHINE), _step(_EQUAL, machine, 1, 0), _step(_RETURN, _KILL), _step(_LOAD, _NUMBER)]
    for numbers in _CALLS.values():
        if (number := numbers[column]) is not None:
            code += [_step(_EQUAL, number, 0, 1), _step(_RETURN, _ALLOW)]
    for of_x86, of_arm, flags in _OPEN.values():
        if (number := (of_x86, of_arm)[column]) is not None:
            code += [_step(_EQUAL, number, 0, 4), _step(_LOAD, _ARGUMENTS + 8 * flags)]
            code += [_step(_ANY_BIT, _WRITING, 0, 1), _step(_RETURN, _REFUSE), _step(_RETURN, _ALLOW)]
    code += [_step(_EQUAL, _IOCTL[column], 0, 3), _step(_LOAD, _ARGUMENTS + 8)]
    code += [_step(_EQUAL, _IS_TERMINAL, 0, 1), _step(_RETURN, _ALLOW)]
    return [*code, _step(_RETURN, _REFUSE)]


def _step(operation: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    """One instruction: the operation, and how many instructions it jumps over."""
    return struct.pack("HBBI", operation, if_true, if_false, value)


class _Arguments(dict[str, str]):
    """Arguments of a file by name; xacro adds those with a default. It remembers which ones the file has."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.known: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.known.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.known.add(name)
        if not super().__contains__(name):
            raise ValueError(f"its argument {name} has no value; {_give(name)}")
        return super().__getitem__(name)


def _give(name: str) -> str:
    return f"give it with --xacro {name}:=VALUE, to a node with robot.xacro"


def _check_known(arguments: _Arguments, given: Mapping[str, str]) -> None:
    """Check that the file, which has been read, has the arguments that are given."""
    if unknown := sorted(set(given) - arguments.known):
        raise ValueError(f"it has no argument {unknown[0]}; it has {', '.join(sorted(arguments.known)) or 'none'}")


def main(file: str, given: Mapping[str, str]) -> int:
    """Expand a file with arguments; returns the exit code."""
    del sys.path[0]  # The folder of this file has modules of other purposes.
    import xacro

    for name in _IMPORTED_LATE:
        with suppress(ImportError):  # Then what needs it reports the error.
            import_module(name)
    xacro.safe_eval = _refuse_hidden_names(xacro.safe_eval)
    arguments = _Arguments(given)
    xacro.check_attrs = _without_default(xacro.check_attrs, arguments)
    try:
        confine()
    except (OSError, ValueError) as error:
        print(error)
        return UNCONFINED
    try:
        text = xacro.process_file(file, mappings=arguments).toxml()
        _check_known(arguments, given)
        print(text)
    except Exception as error:  # xacro raises many kinds.
        print(_cause(error))
        return FAILED
    return 0


def _cause(error: BaseException | None) -> str:
    """An error of xacro, which may have another one as its attribute ``exc``, in one line."""
    text, cause = " ".join(str(error).split()) or type(error).__name__, error
    while cause is not None and not isinstance(cause, MemoryError):
        if type(cause).__name__ == "ArgException":
            return f"its argument {cause} has no value; {_give(str(cause))}"
        cause = getattr(cause, "exc", None)
    return text if cause is None else f"it needs more than {MEMORY / 2**30:g} GB of memory: {text}"


def _without_default(check_attrs: Callable[..., Any], arguments: _Arguments) -> Callable[..., Any]:
    """xacro's `check_attrs`, with which an argument that is given needs no default in the file."""

    def checked(tag: Any, required: list[str], optional: list[str]) -> Any:
        name = tag.getAttribute("name")
        if tag.tagName == "xacro:arg" and name and not tag.hasAttribute("default"):
            tag.setAttribute("default", arguments[name])
        return check_attrs(tag, required, optional)

    return checked


def _refuse_hidden_names(safe_eval: Callable[..., Any]) -> Callable[..., Any]:
    """xacro's `safe_eval`, which looks for hidden names, with functions in an expression looked through too."""

    def names(code: CodeType) -> Iterator[str]:
        yield from code.co_names
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                yield from names(constant)

    def evaluate(expression: str, *variables: Any) -> Any:
        hidden = {name for name in names(compile(expression.strip(), "<expression>", "eval")) if name.startswith("__")}
        if hidden:
            raise ValueError(f"{', '.join(sorted(hidden))} may not be used in a description")
        return safe_eval(expression, *variables)

    return evaluate


if __name__ == "__main__":
    code = main(sys.argv[1], {name: value for name, _, value in (word.partition(":=") for word in sys.argv[2:])})
    sys.stdout.flush()
    os._exit(code)

"""Compiles the kernels when the package is built, by numba and a C compiler: the hook of its wheel.

Where the machine has no C compiler, the one of the package ``ziglang`` serves.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_ROOT: Final = Path(__file__).parents[2]
_ZIG: Final = {"CC": "cc", "CXX": "c++"}
_GENERIC: Final = {"x86_64": "x86-64-v2", "amd64": "x86-64-v2"}
"""Processors that a build for others may count on; of other machines the plainest."""


class KernelHook(BuildHookInterface[Any]):
    """Builds ``mavhums/_kernels_ROOM`` in the source tree and takes them into the wheel."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return what the build needs beside its fixed requirements."""
        return [] if _has_compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and mark the wheel as one for this platform and Python."""
        sys.path.insert(0, str(_ROOT))
        build()
        import_module("mavhums.log.mavlink.dialect").write_definitions()
        build_data["artifacts"] += ["mavhums/_kernels*", "mavhums/_dialect.json"]
        build_data["pure_python"] = False
        build_data["infer_tag"] = True


def build() -> None:
    """Compile the kernels into the source tree, each room in a process, unless they are of these sources."""
    from mavhums.core import kernels

    if kernels.is_built():
        return
    modules = _modules(kernels.PACKAGE)
    if not _has_compiler():
        os.environ |= {name: f"{sys.executable} -m ziglang {call}" for name, call in _ZIG.items()}
    # numba's own level, 3, takes twice the time for loops that are no faster.
    environment = {"NUMBA_OPT": "2", **os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    if sys.platform == "linux":
        environment["LDFLAGS"] = f"{os.environ.get('LDFLAGS', '')} -s"  # half the size, without symbols
    command = [sys.executable, "-m", "mavhums.core.build"]
    rooms = sorted({module.split(".")[1] for module in modules})
    processes = [subprocess.Popen([*command, room], env=environment) for room in rooms]
    codes = [process.wait() for process in processes]
    if any(codes):
        raise RuntimeError("the kernels do not compile, see above; without C and C++: pip install ziglang")
    for module in modules:
        import_module(module)
    own = (module for name, module in sys.modules.items() if name.startswith("mavhums."))
    sources = sorted(Path(module.__file__) for module in own if module.__file__)
    names = [path.relative_to(kernels.PACKAGE).as_posix() for path in sources]
    text = "\n".join([kernels.digest(sources), *names])
    (kernels.PACKAGE / kernels.SOURCES).write_text(text, encoding="utf-8")


def _modules(package: Path) -> list[str]:
    """Return the modules that have kernels."""
    paths = (path for path in sorted(package.rglob("*.py")) if path != package / "core" / "build.py")
    return [
        ".".join(path.relative_to(package.parent).with_suffix("").parts)
        for path in paths
        if "from mavhums.core.kernels import" in path.read_text(encoding="utf-8")
    ]


def build_room(room: str) -> None:
    """Compile the kernels of a room into its extension module."""
    from mavhums.core import kernels

    numba: Any = import_module("numba")
    pycc: Any = import_module("numba.pycc")
    compile_extra: Any = pycc.compiler.compile_extra

    def compile_alone(*arguments: Any, **more: Any) -> Any:
        """Compile with flags of its own, as the compiler changes them, and without the GIL."""
        *others, flags = arguments
        own = flags.copy()
        own.release_gil = True
        return compile_extra(*others, own, **more)

    pycc.compiler.compile_extra = compile_alone
    own = [module for module in _modules(kernels.PACKAGE) if module.split(".")[1] == room]
    for module in own:
        import_module(module)
    extension = pycc.CC(f"_kernels_{room}")
    extension.output_dir = str(kernels.PACKAGE)
    extension.target_cpu = _GENERIC.get(platform.machine().lower(), "")
    for symbol, function in kernels.KERNELS.items():
        if function.__module__ in own:
            kinds = kernels.kinds_of(function).parts
            extension.export(symbol, tuple(numba.typeof(_sample(kind)) for kind in kinds))(function)
    extension.compile()


def _sample(kind: Any) -> Any:
    """Return a value of what a kernel takes."""
    from mavhums.core.arrays import Block
    from mavhums.core.kernels import Group

    if isinstance(kind, Block):
        return np.zeros((1,) * kind.ndim, kind.dtype)
    if isinstance(kind, Group):
        parts = [*map(_sample, kind.parts)]
        return tuple(parts) if kind.of is tuple else kind.of(*parts)
    return kind(1)


def _has_compiler() -> bool:
    """Return whether the compilers that this Python names are there; numba tries the one of C++, too."""
    named = (os.environ.get(name) or sysconfig.get_config_var(name) or "" for name in _ZIG)
    return os.name == "nt" or all(shutil.which(command.split(" ")[0]) for command in named)


if __name__ == "__main__":
    build_room(sys.argv[1])

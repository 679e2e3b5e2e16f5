"""Makes NumPy and BLAS compute the same results on every processor of level x86-64-v3.

Both select kernels by the features of the processor, and kernels differ in the last bits.

This module makes the selection instead, by environment variables that both read when they are imported: NumPy does not
use its AVX-512 kernels; OpenBLAS uses its Haswell kernels and one thread, because the number of threads decides how
sums are split. Variables that are already set are kept. This is the first module of every process, so it imports
nothing that is slow or that imports NumPy.
"""

from __future__ import annotations

import os
import sys
from functools import cache

TYPE_CHECKING = False  # as in `typing`, whose import takes longer than all the rest here
if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

_LEVELS = {
    "x86-64-v2": "cx16 lahf_lm popcnt pni sse4_1 sse4_2 ssse3",
    "x86-64-v3": "abm avx avx2 bmi1 bmi2 f16c fma movbe xsave",
    "x86-64-v4": "avx512f avx512bw avx512cd avx512dq avx512vl",
}
"""The flags, by their Linux names, that each level adds to the previous one (System V ABI for x86-64, 3.1.1)."""

_ICE_LAKE = f"{_LEVELS['x86-64-v4']} avx512_vnni avx512ifma avx512vbmi avx512_vbmi2 avx512_bitalg avx512_vpopcntdq"

_GROUPS = {
    "X86_V4": _LEVELS["x86-64-v4"],
    "AVX512_ICL": _ICE_LAKE,
    "AVX512_SPR": f"{_ICE_LAKE} avx512_fp16",
}
"""NumPy's names of groups of AVX-512 kernels, and the processor flags with which it would select them."""

_GROUPS_BEFORE_2_4 = {
    "AVX512F": "avx512f",
    "AVX512CD": "avx512f avx512cd",
    "AVX512_SKX": _LEVELS["x86-64-v4"],
    "AVX512_CLX": f"{_LEVELS['x86-64-v4']} avx512_vnni",
    "AVX512_CNL": f"{_LEVELS['x86-64-v4']} avx512ifma avx512vbmi",
    "AVX512_ICL": _ICE_LAKE,
}

_ABOVE_V3 = ("AVX512F", "AVX512BW", "AVX512CD", "AVX512DQ", "AVX512VL")
"""The names of the flags of the level above in the GNU C library."""

_KERNEL = "Haswell"
"""The kernels of OpenBLAS for processors of level x86-64-v3."""


class ProcessorWarning(RuntimeWarning):
    """Results may differ in their last bits on another processor of the same level."""


def pin() -> None:
    """Make NumPy and OpenBLAS select the kernels that every processor of the level has when they are imported.

    This uses environment variables, so child processes do the same. If NumPy was already imported, nothing is changed.
    """
    if "numpy" in sys.modules:
        return
    if not any(name in os.environ for name in ("NPY_DISABLE_CPU_FEATURES", "NPY_ENABLE_CPU_FEATURES")):
        groups = avx512_groups()
        if groups:
            os.environ["NPY_DISABLE_CPU_FEATURES"] = " ".join(groups)
    if _promised():
        # A kernel that the processor cannot run would end the process.
        os.environ.setdefault("OPENBLAS_CORETYPE", _KERNEL)
    if not any(name in os.environ for name in ("OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS")):
        os.environ["OPENBLAS_NUM_THREADS"] = "1"


def environment() -> dict[str, str]:
    """The variables with which another process computes exactly as this one does, even if this one is not pinned."""
    found = dict(os.environ)
    kernels = numpy_kernels()
    if kernels is not None and "NPY_ENABLE_CPU_FEATURES" not in found and "NPY_DISABLE_CPU_FEATURES" not in found:
        found["NPY_DISABLE_CPU_FEATURES"] = " ".join(name for name in avx512_groups() if name not in kernels)
    for each in [each for each in blas() if each.dynamic][:1]:
        found["OPENBLAS_CORETYPE"], found["OPENBLAS_NUM_THREADS"] = each.kernel, str(each.threads)
    return found


VARIABLES = (
    "NPY_DISABLE_CPU_FEATURES",
    "NPY_ENABLE_CPU_FEATURES",
    "OPENBLAS_CORETYPE",
    "OPENBLAS_NUM_THREADS",
    "GOTO_NUM_THREADS",
    "OMP_NUM_THREADS",
    "GLIBC_TUNABLES",
)
"""The names of the known variables that select kernels."""


def variables() -> dict[str, str]:
    """The variables of `VARIABLES` with which another process computes as this one does."""
    return {name: value for name, value in environment().items() if name in VARIABLES}


def emulated(wanted: str) -> dict[str, str]:
    """The variables with which a process computes as on a processor of a lower level, as far as this one can.

    Args:
        wanted: ``x86-64-v3``, or ``x86-64-v2``, which has neither AVX2 nor fused multiplication and addition (FMA).
    """
    above, groups, kernel = list(_ABOVE_V3), avx512_groups(), _KERNEL
    if wanted == "x86-64-v2":
        above += ["AVX2", "FMA"]
        groups = [*_groups_of_v3(), *groups]
        kernel = "Nehalem"
    found = {"NPY_DISABLE_CPU_FEATURES": " ".join(groups)}
    if _flags() >= _needed(wanted):
        found["OPENBLAS_CORETYPE"] = kernel
    if _c_library().startswith("glibc"):
        found["GLIBC_TUNABLES"] = f"glibc.cpu.hwcaps={','.join(f'-{name}' for name in above)}"
    return found


def _groups_of_v3() -> list[str]:
    """The groups of NumPy's kernels between its baseline and AVX-512 that this processor has."""
    if not _promised():
        return []
    return ["X86_V3"] if _numpy_version() >= (2, 4) else ["AVX", "F16C", "FMA3", "AVX2"]


def avx512_groups() -> list[str]:
    """The groups of AVX-512 kernels that the installed NumPy would select on this processor.

    No others are returned, because NumPy warns of groups that it does not know or that the processor lacks.
    """
    flags = _flags()
    if not any(flag.startswith("avx512") for flag in flags):
        return []
    groups = _GROUPS_BEFORE_2_4 if _numpy_version() < (2, 4) else _GROUPS
    return [name for name, needed in groups.items() if flags >= set(needed.split())]


def level() -> str | None:
    """The highest level of x86-64 that the processor has; None if unknown."""
    reached = [name for name in _LEVELS if _flags() >= _needed(name)]
    return reached[-1] if reached else None


def in_force() -> dict[str, str]:
    """The factors in numerical results, by name: processor, NumPy's kernels, BLAS, C library, and whether pinned."""
    kernels, short = numpy_kernels(), shortfall()
    return {
        "Processor": " ".join(filter(None, (_info().get("model name"), level() and f"({level()})"))) or "unknown",
        "NumPy kernels": "unknown" if kernels is None else " ".join(kernels) or "baseline",
        "BLAS": " and ".join(sorted({str(each) for each in blas()})) or "unknown",
        "C library": _c_library(),
        "Pinned": f"no: {short}" if short else "yes" if _promised() else "no: not of level x86-64-v3",
    }


def shortfall() -> str | None:
    """Why results may differ in their last bits on another processor of the level; None if they do not.

    Equal results are promised neither on processors below the level nor on architectures other than x86-64.
    """
    if not _promised():
        return None
    beyond = [name for name in numpy_kernels() or () if name.startswith("AVX512") or name == "X86_V4"]
    others = sorted({each.kernel for each in blas() if each.dynamic} - {_KERNEL})
    what = [f"NumPy uses its kernels {' '.join(beyond)}"] if beyond else []
    what += [f"OpenBLAS uses its kernel {' '.join(others)}"] if others else []
    if not what:
        return None
    why = "set by the environment, or NumPy was imported before symaware_cli"
    return f"{' and '.join(what)} ({why}): on another processor results may differ in their last bits"


_has_warned = False


def warn_once(stacklevel: int) -> None:
    """Warn of a shortfall, once in a process; `stacklevel` is that of `warnings.warn`, seen from the caller."""
    global _has_warned
    said = None if _has_warned else shortfall()
    if said:
        import warnings

        _has_warned = True
        warnings.warn(said, ProcessorWarning, stacklevel=stacklevel + 1)


def _promised() -> bool:
    return _flags() >= _needed("x86-64-v3")


def numpy_kernels() -> list[str] | None:
    """The groups of kernels beyond its baseline that NumPy uses; None if it is not imported or does not report them."""
    multiarray = sys.modules.get("numpy._core._multiarray_umath")
    try:
        return [name for name in multiarray.__cpu_dispatch__ if multiarray.__cpu_features__[name]]  # type: ignore[union-attr]
    except (AttributeError, KeyError):
        return None


class Blas:
    """A loaded OpenBLAS library.

    Attributes:
        kernel: The processor that its kernels are for, such as ``Haswell``.
        version: Its version; empty if unknown.
        threads: The number of threads that it may use.
        dynamic: Whether it selected its kernel by the processor; CasADi's is built with a single one.
    """

    def __init__(self, kernel: str, version: str, threads: int, dynamic: bool = True) -> None:
        self.kernel = kernel
        self.version = version
        self.threads = threads
        self.dynamic = dynamic

    def __str__(self) -> str:
        return f"OpenBLAS {self.version} {self.kernel}, {self.threads} thread{'s' if self.threads != 1 else ''}"


def blas() -> list[Blas]:
    """Each OpenBLAS that this process has loaded; empty if that is unknown."""
    return [_opened(path) for path in _loaded("openblas")]


@cache
def _opened(path: str) -> Blas:
    """Query a library; its functions have other names in the wheels of NumPy and SciPy than elsewhere."""
    import ctypes

    library = ctypes.CDLL(path)

    def call(name: str, kind: type[Any]) -> Any:
        for prefix, suffix in (("scipy_", "64_"), ("scipy_", ""), ("", "64_"), ("", "")):
            function = getattr(library, f"{prefix}openblas_get_{name}{suffix}", None)
            if function is not None:
                function.restype = kind
                return function()
        return None

    def text(name: str) -> str:
        return (call(name, ctypes.c_char_p) or b"").decode(errors="replace")

    configuration = text("config").split()
    version = next((word for word in configuration if word[:1].isdigit()), "")
    threads = call("num_threads", ctypes.c_int) or 0
    return Blas(text("corename") or "unknown", version, threads, "DYNAMIC_ARCH" in configuration)


def _loaded(name: str) -> list[str]:
    """The paths of the loaded libraries whose file names contain a name, as listed by the dynamic loader of Linux.

    /proc/self/maps lists them as well, together with each range of memory: it takes milliseconds to read.
    """
    import ctypes

    paths = []

    def look(library: int, size: int, data: int | None) -> int:
        # A `dl_phdr_info` begins with an address and the path.
        path = ctypes.c_char_p.from_address(library + ctypes.sizeof(ctypes.c_void_p)).value
        paths.append(os.fsdecode(path or b""))
        return 0

    callback = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)(look)
    try:
        ctypes.CDLL(None).dl_iterate_phdr(callback, None)
    except (AttributeError, OSError, TypeError):  # another operating system
        return []
    return sorted(os.path.realpath(path) for path in paths if name in os.path.basename(path) and ".so" in path)


def _c_library() -> str:
    try:
        version = os.confstr("CS_GNU_LIBC_VERSION")
    except (AttributeError, OSError, ValueError):
        version = None
    tunables = os.environ.get("GLIBC_TUNABLES", "")
    return " ".join(filter(None, (version or "unknown", tunables and f"with {tunables}")))


@cache
def _info() -> dict[str, str]:
    """The entries of the first processor in /proc/cpuinfo."""
    try:
        with open("/proc/cpuinfo") as lines:
            return dict(_entries(lines))
    except OSError:
        return {}


def _entries(lines: Iterator[str]) -> Iterator[tuple[str, str]]:
    for line in lines:
        name, colon, value = line.partition(":")
        if not colon:
            return  # an empty line: the next is another processor
        yield name.strip(), value.strip()


def _flags() -> set[str]:
    return set(_info().get("flags", "").split())


@cache
def _needed(name: str) -> set[str]:
    """The flags of a level and of all before it."""
    needed: set[str] = set()
    for each, flags in _LEVELS.items():
        needed |= set(flags.split())
        if each == name:
            break
    return needed


def _numpy_version() -> tuple[int, int]:
    """Major and minor version of the NumPy that would be imported; the latest known one if undetermined."""
    loaded = sys.modules.get("numpy")
    text = getattr(loaded, "__version__", None) or _version_on_path()
    major, _, rest = text.partition(".")
    try:
        return int(major), int(rest.partition(".")[0])
    except ValueError:
        return (2, 4)


def _version_on_path() -> str:
    """The version of NumPy in the name of the folder that pip leaves beside it."""
    for folder in sys.path:
        try:
            names = os.listdir(folder or ".")
        except OSError:
            continue
        for name in names:
            if name.startswith("numpy-") and name.endswith((".dist-info", ".egg-info")):
                return name.split("-")[1]
    return ""

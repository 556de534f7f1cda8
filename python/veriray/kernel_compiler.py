"""Compiles one kernel with NVRTC: a program of its own, so that a failure stays here.

python kernel_compiler.py LIBRARY SOURCES ARCHITECTURE FEATURES METHOD OUTPUT

LIBRARY: path of libnvrtc. SOURCES: folder of the C++ headers. ARCHITECTURE: for example sm_90.
FEATURES: the mask of the scene. METHOD: fused or wavefront. OUTPUT: the file of the machine code;
it appears whole or not at all. Ends with status 1 and the compiler's log where that fails. Imports
no package.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile

#: The bit contract: nothing fused, nothing approximated (CONTRIBUTING.md).
CONTRACT = ("-fmad=false", "-prec-div=true", "-prec-sqrt=true", "-ftz=false")
SOURCE = b'#include "backends/run_time/kernel.cuh"\n'


def options(sources: str, architecture: str, features: int, method: str) -> list[str]:
    """What the compiler is told."""
    return [
        f"-arch={architecture}",
        "-std=c++20",
        "-default-device",
        *CONTRACT,
        f"-I{sources}",
        f"-I{sources}/backends/run_time",
        "-DVR_INTEGRATOR=0",
        f"-DVR_FEATURES={features}ull",
        *(["-DVR_WAVEFRONT"] if method == "wavefront" else []),
    ]


def machine_code(library: str, arguments: list[str]) -> bytes:
    """The code for the source with these options; RuntimeError with the log where it fails."""
    nvrtc = ctypes.CDLL(library)
    program = ctypes.c_void_p()

    def text(what: str) -> bytes:
        size = ctypes.c_size_t()
        check(getattr(nvrtc, f"nvrtcGet{what}Size")(program, ctypes.byref(size)))
        out = ctypes.create_string_buffer(size.value)
        check(getattr(nvrtc, f"nvrtcGet{what}")(program, out))
        return out.raw

    def check(status: int) -> None:
        if status:
            nvrtc.nvrtcGetErrorString.restype = ctypes.c_char_p
            raise RuntimeError(nvrtc.nvrtcGetErrorString(status).decode())

    check(nvrtc.nvrtcCreateProgram(ctypes.byref(program), SOURCE, b"kernel.cu", 0, None, None))
    given = (ctypes.c_char_p * len(arguments))(*(a.encode() for a in arguments))
    if nvrtc.nvrtcCompileProgram(program, len(arguments), given):
        raise RuntimeError(text("ProgramLog").decode(errors="replace"))
    return text("CUBIN")


def main(
    library: str, sources: str, architecture: str, features: str, method: str, output: str
) -> int:
    """Compiles as the arguments say."""
    try:
        code = machine_code(library, options(sources, architecture, int(features), method))
        folder = os.path.dirname(output)
        descriptor, temporary = tempfile.mkstemp(dir=folder, prefix=".kernel-")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(code)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, output)
        except BaseException:
            os.unlink(temporary)
            raise
    except (OSError, RuntimeError, AttributeError) as error:
        sys.stderr.write(f"{error}"[:4000] + "\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

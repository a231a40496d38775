"""Where libraries that FMUs need usually come from: packages of Debian, and runtimes of tools."""

import re
from collections.abc import Mapping

_MATLAB = "comes with MATLAB and with the free MATLAB Runtime: install the version with which it was exported"
_INTEL = "comes with the runtime of Intel's compilers: install intel-oneapi-runtime-compilers"

_SOURCES: Mapping[str, str] = {
    r"libgfortran\.so\.(\d)": "is in the Debian package libgfortran{0}",
    r"libquadmath\.so\.0": "is in the Debian package libquadmath0",
    r"libgomp\.so\.1": "is in the Debian package libgomp1",
    r"libstdc\+\+\.so\.6": "is in the Debian package libstdc++6",
    r"libgcc_s\.so\.1": "is in the Debian package libgcc-s1",
    r"libc\+\+\.so\.1": "is in the Debian package libc++1",
    r"libpython(\d)\.(\d+)m?\.so.*": "is in the Debian package libpython{0}.{1}; "
    "the FMU runs only with this version of Python",
    r"libpython3\.so": "is in the Debian package libpython3-dev; the FMU uses Python",
    r"python(\d)(\d+)\.dll": "comes with Python {0}.{1} for Windows; the FMU runs only with this version",
    r"lib(openblas)\.so\.0": "is in the Debian package libopenblas0",
    r"lib(blas|lapack)\.so\.3": "is in the Debian package lib{0}3",
    r"libz\.so\.1": "is in the Debian package zlib1g",
    r"libexpat\.so\.1": "is in the Debian package libexpat1",
    r"libxml2\.so\.2": "is in the Debian package libxml2",
    r"libzmq\.so\.5": "is in the Debian package libzmq5",
    r"libcurl\.so\.4": "is in the Debian package libcurl4",
    r"libuuid\.so\.1": "is in the Debian package libuuid1",
    r"lib(ssl|crypto)\.so\.3": "is in the Debian package libssl3",
    r"lib(ssl|crypto)\.so\.1\.1": "is of OpenSSL 1.1, which current systems do not have: export it again",
    r"libX11\.so\.6": "is in the Debian package libx11-6",
    r"libGL\.so\.1": "is in the Debian package libgl1",
    r"libtbb\.so\.12": "is in the Debian package libtbb12",
    r"libgsl\.so\.(\d+)": "is in the Debian package libgsl{0}",
    r"libgnat-(\d+)\.so.*": "is in the Debian package libgnat-{0}",
    r"libboost_(\w+)\.so\.([\d.]+)": "is in the Debian package libboost-{0}{1}",
    r"libsundials_\w+\.so.*": "is of SUNDIALS, in a Debian package libsundials-*",
    r"libc\.musl-.*": "is of musl: the FMU was built for Alpine Linux; build it for a system with glibc",
    r"libjvm\.so|jvm\.dll": "comes with Java: install it, such as the Debian package default-jre, and set "
    "LD_LIBRARY_PATH to its folder lib/server",
    r"libmonosgen-2\.0\.so.*": "is in the Debian package libmono-2.0-1",
    r"libcudart\.so.*": "comes with CUDA",
    r"lib(mw\w+|mx|mat|eng|ut)\.so.*|mcl\w+\.dll": _MATLAB,
    r"lib(SimulationRuntime|OpenModelicaRuntime|OpenModelicaFMIRuntime|omc)\w*\.so.*": "comes with "
    "OpenModelica: install it, or export with --fmuRuntimeDepends=all",
    r"lib(dymola|ds)\w*\.so.*|dsin\w*\.dll": "comes with Dymola: export with its option for binaries "
    "that need no license or runtime",
    r"lib(iomp5|imf|svml|intlc|irng|irc|ifcore\w*|ifport)\.so.*|lib(iomp5md|mmd|ifcoremd)\.dll": _INTEL,
    r"libmkl_\w+\.so.*|mkl_\w+\.dll": "comes with Intel MKL",
    r"(vcruntime|msvcp|concrt|vcomp)\d+(_\d)?\.dll": "comes with the Visual C++ Redistributable of Microsoft",
    r"(vcruntime|msvcp)\d+d\.dll|ucrtbased\.dll": "is for debugging and comes with Visual Studio only: "
    "build the FMU as a release",
}
"""What to say of a library, by a pattern for its name; `{0}` is the first group of the pattern."""

_GLIBC = {
    "2.28": "Debian 10, Red Hat Enterprise Linux 8",
    "2.31": "Debian 11, Ubuntu 20.04",
    "2.34": "Red Hat Enterprise Linux 9",
    "2.35": "Ubuntu 22.04",
    "2.36": "Debian 12",
    "2.39": "Ubuntu 24.04, Red Hat Enterprise Linux 10",
    "2.41": "Debian 13",
}
"""Systems by their version of glibc."""

_GCC = {
    "GLIBCXX_3.4.26": "9",
    "GLIBCXX_3.4.28": "10",
    "GLIBCXX_3.4.29": "11",
    "GLIBCXX_3.4.30": "12",
    "GLIBCXX_3.4.31": "13.1",
    "GLIBCXX_3.4.32": "13.2",
    "GLIBCXX_3.4.33": "14",
    "GLIBCXX_3.4.34": "15",
    "CXXABI_1.3.13": "11",
    "CXXABI_1.3.14": "13",
    "CXXABI_1.3.15": "14",
    "GFORTRAN_9": "9",
    "GFORTRAN_10": "10",
}
"""Versions of GCC with which versions of its libraries came."""


def find_source(library: str) -> str:
    """Return where a library usually comes from, as the end of a message; empty if that is not known.

    Args:
        library: The name of the file, such as `libgfortran.so.5`.
    """
    for pattern, text in _SOURCES.items():
        if match := re.fullmatch(pattern, library, re.IGNORECASE):
            return text.format(*match.groups())
    return ""


def find_system_with_glibc(version: str) -> str:
    """Return the oldest systems with this version of glibc; empty if the table has none."""
    needed = parse_version(version)
    return next((systems for glibc, systems in _GLIBC.items() if parse_version(glibc) >= needed), "")


def find_version_of_gcc(symbol_version: str) -> str:
    """Return the version of GCC whose libraries have a version such as `GLIBCXX_3.4.30`; empty if unknown."""
    return _GCC.get(symbol_version, "")


def parse_version(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, such as `2.36` or `GLIBCXX_3.4.30`, to compare it with others."""
    return tuple(int(word) for word in re.findall(r"\d+", version))

"""The kernels: loops in C++, compiled when the package is built, into a library that works with every Python.

A new kernel needs three pieces:

1. The loop, a template over the number type, in a header (``arrays.h``)::

       template <class T> i64 copied(i64 n, const T* source, T* target, i32 threads) {
           parallel_blocks(n, BLOCK, threads, [&](i64 first, i64 last, i64, i32) { ... });
           return 0;  // or a count; NO_MEMORY, CANCELLED on failure
       }

2. Its export, in a ``.cpp`` (``arrays.cpp``): ``MESHFLOW_KERNEL(copied)`` for float and double; ``MESHFLOW_KERNEL_OF_ONE(name)``
   for a function that is no template. Every ``*.cpp`` of this folder is compiled separately, once for each instruction set. One
   file per subject uses all processors, and only changed files are compiled again.

3. Its declaration, in a module of Python (``arrays.py``): a function without a body below ``@kernel``, whose annotations
   describe the arguments. Named sizes of shapes are passed first, in the order in which they are first named, as ``i64``::

       @kernel
       def copied(source: Annotated[Array, read("T", "n")], target: Annotated[Array, write("T", "n")],
                  threads: Annotated[int | None, threads] = None) -> None:

   ``parameters.py`` has the annotations: ``read``, ``write`` (optional, strided, written over another one, indices below a size),
   ``integer``, ``size``, ``real``, ``threads``, ``stop``, ``struct`` (with ``MESHFLOW_LAYOUT`` in C++). Declaration and compiled
   function are compared on the first call; arguments are checked on every call.

There is no C++ runtime: no exceptions, no ``new``, no containers of the standard library. Work arrays come from the caller or
from ``Memory`` (``memory.h``), threads from ``parallel_for`` (``team.h``). Results depend neither on threads nor on the
instruction set. In a source tree the next use of a kernel compiles what has changed (``library.py``). ``.ci/sanitize address``
runs the tests of kernels with memory checks; ``.ci/cross`` compiles for other machines.
"""

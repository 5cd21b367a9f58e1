"""The loops, in C++: compiled when the package is built, into a library that serves every Python.

To add a kernel, three pieces:

1. The loop, a template over the number type, in a header (``arrays.h``)::

       template <class T> i64 copied(i64 n, const T* source, T* target, i32 threads) {
           parallel_blocks(n, BLOCK, threads, [&](i64 first, i64 last, i64, i32) { ... });
           return 0;  // or a count; NO_MEMORY, CANCELLED where it could not be done
       }

2. Its way out, in a ``.cpp`` (``arrays.cpp``): ``MESHFLOW_KERNEL(copied)`` for float and double; ``MESHFLOW_KERNEL_OF_ONE(name)``
   for a function that is no template. Every ``*.cpp`` of this folder is compiled by itself, once for each instruction set; one
   file for each subject keeps all processors busy, and only what has changed is compiled again.

3. Its declaration, in a module of Python (``arrays.py``): a function without a body below ``@kernel``, whose annotations say what
   may come. Sizes that shapes name are handed over first, in the order in which they are first named, as ``i64``::

       @kernel
       def copied(source: Annotated[Array, read("T", "n")], target: Annotated[Array, write("T", "n")],
                  threads: Annotated[int | None, threads] = None) -> None:

   ``parameters.py`` has what there is: ``read``, ``write`` (optional, strided, written over another one, indices below a size),
   ``integer``, ``size``, ``real``, ``threads``, ``stop``, ``struct`` (with ``MESHFLOW_LAYOUT`` in C++). Declaration and compiled
   function are compared on the first call; what comes in is checked on every call.

There is no C++ runtime: no exceptions, no ``new``, no containers of the standard library. Room to work in comes from the caller
or from ``Memory`` (``memory.h``); threads from ``parallel_for`` (``team.h``). Results depend on neither
threads nor instruction set. In a source tree nothing has to be called to compile: the next use of a kernel does
(``library.py``). ``.ci/sanitize address`` runs the tests of kernels with checks of memory, ``.ci/cross`` compiles for other
machines.
"""

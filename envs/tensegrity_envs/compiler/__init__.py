"""Component code to machine code: traced once, written as vector code over environments, compiled by LLVM, cached.

**What a component function may do.** It takes and returns components: numbers, in tuples, named tuples, dicts and
designs (pytrees). It may do arithmetic and comparisons on them, combine conditions by `&`, `|`, `~`, and call the
functions of their namespace (`xp = namespace_of(x)`: sin, cos, sqrt, log, atan2, hypot, minimum, maximum, where,
isfinite), `to_single`, and `mechanics.equilibrium.continuation`. It may use Python's control flow on anything but
components: on integers, on how many there are, on whether something is None. A branch on a component is an error: use
`xp.where`, both sides of which are computed. Run on floats, arrays or tensors, the same function is an ordinary one.

**What becomes of it.** `Kernel(function, *schemas)`

1. runs it on symbols (`tracing`), which write their operations down: repeated ones once;
2. takes floats of designs, tasks and limits as data, told apart by where they come from and not by their value
   (`numbers`): a design with other numbers runs the same code, and its functions are not even traced again (`traces`);
3. writes the operations as a loop over columns, eight of them in an instruction (`loops`), and hand-written loops,
   such as the continuation of an equilibrium (`continuation`), from a small part of Python (`lowering`, `jit`);
4. lets LLVM compile that (`machine`), once for all processes of a user (`store`): keys are the operations and the
   compiler's version, files are checked before they are used;
5. is called with matrices, a row for each component and a column for each environment (`pytree.Schema`, `calling`).

One column gives what it gives among many, to the last bit: there is one version of the code. `threads` lets several
processor cores evaluate a kernel. `evaluate(function, ...)` does all that for floats and arrays. `TENSEGRITY_CACHE_DIR`
moves the cache; `compile_all` fills it.

**How to look at a kernel's code.** `print(kernel.source())` is LLVM's intermediate representation, `kernel.graph.ops`
the operations, `kernel.constants` the data by source.

**How to debug one.** Call the component function itself on floats or NumPy arrays, with a debugger or prints in it;
only `continuation` needs a trace, and runs as plain Python on matrices, with any Python function as its Newton step:
`continuation.follower(newton, n, lambda function: function)`."""

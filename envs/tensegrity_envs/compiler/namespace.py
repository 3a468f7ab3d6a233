"""Where a component's arithmetic comes from: `math` for floats, NumPy for arrays, Torch for tensors, JAX for its own.

Every equation of this package is written once, on components (`alpha1, alpha2 = q`). A component is a float, a NumPy
array, a Torch tensor or an array of JAX; the libraries spell `sin`, `cos`, `sqrt`, `log` alike, and this module
supplies the few names that they do not share. Torch and JAX are never imported here: a tensor can only arrive when its
caller has it. A `tracing.Symbol` is a component too: it brings its own namespace, which writes the operations down.
"""

import math
import sys
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

# A float, a NumPy array, a Torch tensor or an array of JAX. Arithmetic is the same in all; no static type says that.
Component = Any
Components = tuple[Component, ...]


class Namespace(Protocol):
    """The functions of components that `math`, NumPy, Torch and tracing have in common; see `namespace_of`."""

    def sin(self, x: Component, /) -> Component:
        """Sine."""
        ...

    def cos(self, x: Component, /) -> Component:
        """Cosine."""
        ...

    def sqrt(self, x: Component, /) -> Component:
        """Square root."""
        ...

    def log(self, x: Component, /) -> Component:
        """Natural logarithm."""
        ...

    def atan2(self, y: Component, x: Component, /) -> Component:
        """Angle of (x, y) [rad]."""
        ...

    def hypot(self, x: Component, y: Component, /) -> Component:
        """sqrt(x^2 + y^2)."""
        ...

    def minimum(self, x: Component, y: Component, /) -> Component:
        """The smaller one."""
        ...

    def maximum(self, x: Component, y: Component, /) -> Component:
        """The larger one."""
        ...

    def where(self, condition: Component, x: Component, y: Component, /) -> Component:
        """x where the condition holds, elsewhere y."""
        ...

    def isfinite(self, x: Component, /) -> Component:
        """Whether it is a number, and not infinite."""
        ...


_SCALAR: Any = SimpleNamespace(
    sin=math.sin,
    cos=math.cos,
    sqrt=math.sqrt,
    log=math.log,
    atan2=math.atan2,
    hypot=math.hypot,
    minimum=min,
    maximum=max,
    where=lambda condition, a, b: a if condition else b,
    isfinite=math.isfinite,
)
_TORCH: list[Namespace] = []
_JAX: list[Namespace] = []


def _torch_namespace() -> Namespace:
    if not _TORCH:
        torch = sys.modules["torch"]

        def pairwise(function: Any) -> Any:
            return lambda a, b: function(torch.as_tensor(a), torch.as_tensor(b))

        _TORCH.append(
            SimpleNamespace(
                sin=torch.sin,
                cos=torch.cos,
                sqrt=torch.sqrt,
                log=torch.log,
                atan2=torch.atan2,
                hypot=torch.hypot,
                minimum=pairwise(torch.minimum),
                maximum=pairwise(torch.maximum),
                where=torch.where,
                isfinite=torch.isfinite,
            )
        )
    return _TORCH[0]


def _jax_namespace() -> Namespace:
    if not _JAX:
        jnp = sys.modules["jax.numpy"]
        same = ("sin", "cos", "sqrt", "log", "hypot", "minimum", "maximum", "where", "isfinite")
        _JAX.append(SimpleNamespace(atan2=jnp.arctan2, **{name: getattr(jnp, name) for name in same}))
    return _JAX[0]


def namespace_of(*components: Component) -> Namespace:
    """The namespace for these components: JAX or Torch if any is one of theirs, NumPy if any is an array, else `math`.

    Raises:
        TypeError: there are both tensors and arrays.
    """
    found: Namespace = _SCALAR
    tensor = False
    jax = False
    for component in components:
        kind = type(component)
        if kind is float or kind is int:
            continue
        if isinstance(component, np.ndarray):
            found = np
        elif hasattr(kind, "namespace"):  # a symbol, or a number of a traced function; both have the same one
            traced: Namespace = kind.namespace
            return traced
        elif is_tensor(component):
            tensor = True
        elif is_jax(component):
            jax = True
    if jax:
        return _jax_namespace()
    if not tensor:
        return found
    if found is np:
        raise TypeError(
            "NumPy arrays and Torch tensors are mixed: convert all of them to one kind, arrays by "
            "torch.as_tensor(array) or tensors by tensor.numpy(); a batch of designs is of arrays"
        )
    return _torch_namespace()


def is_symbol(*components: Component) -> bool:
    """Whether any of the components is a symbol: the caller is being traced."""
    return any(hasattr(type(component), "graph") for component in components)


def to_single(component: Component) -> Component:
    """A component rounded to single precision, as observations hold it; still of double type."""
    if isinstance(component, np.ndarray):
        return component.astype(np.float32).astype(float)
    if hasattr(type(component), "namespace"):
        return type(component).namespace.single(component)
    if is_jax(component):
        return component.astype(np.float32).astype(component.dtype)
    return float(np.float32(component))


def is_tensor(component: object) -> bool:
    """Whether a component is a Torch tensor."""
    return type(component).__module__.startswith("torch")


def is_jax(component: object) -> bool:
    """Whether a component is an array of JAX, or what stands for one while a function is traced."""
    return type(component).__module__.startswith("jax")


def detached(component: Component) -> Component:
    """A tensor's numbers as an array, or a float if it holds one; any other component as it is."""
    if not is_tensor(component):
        return component
    array = component.detach().cpu().numpy()
    return array if array.ndim else float(array)


def as_components(values: Sequence[Any]) -> Components:
    """Numbers as floats; arrays and tensors as they are."""
    return tuple(v if is_tensor(v) or np.ndim(v) else float(v) for v in values)


def is_batch(*components: Component) -> bool:
    """Whether any of the components is an array, a tensor or a symbol."""
    return any(
        is_symbol(c) or namespace_of(c) not in (_SCALAR, getattr(type(c), "namespace", None)) for c in components
    )

"""Taichi's pass over the source of kernels, which no cache spares a start, made cheaper: the same kernels from it, to the last bit.

Taichi 1.7.4 reads, unwraps and parses the source of a function anew wherever it is inlined; for messages that are rarely shown it
draws the source position of each node that it visits, of each again wherever it is inlined or unrolled; and it reads the source
around a decorator to see whether that stands in a class, and the whole stack for each component of a field. Here each function is
parsed once, a position is a file and a line, and a class is known by its names. Where Taichi's internals are not those of 1.7.4
nothing is changed: this is only a matter of speed.
"""

from __future__ import annotations

import ast
import importlib
import linecache
import sys
import textwrap
from typing import Any

from taichi_membrane.collector import no_collection

# The names of Taichi that are read or replaced, by module.
_NAMES = {
    "ast.ast_transformer_utils": ("ASTTransformerContext",),
    "impl": ("get_traceback",),
    "kernel_impl": (
        "_get_tree_and_ctx",
        "_get_global_vars",
        "_inside_class",
        "getsourcefile",
        "getsourcelines",
        "transform_tree",
    ),
    "snode": ("get_traceback",),
}


def hasten(taichi: Any) -> bool:
    """Make the pass cheaper; False, and no change, where Taichi's internals are unlike those of 1.7.4."""
    if getattr(taichi, "__version__", None) != (1, 7, 4):
        return False
    modules: dict[str, Any] = {name: importlib.import_module(f"taichi.lang.{name}") for name in _NAMES}
    if not all(hasattr(modules[module], name) for module, names in _NAMES.items() for name in names):
        return False
    kernel_impl = modules["kernel_impl"]
    parsed = _Parsed(kernel_impl)
    modules["ast.ast_transformer_utils"].ASTTransformerContext.get_pos_info = _position
    modules["impl"].get_traceback = modules["snode"].get_traceback = _caller
    kernel_impl._get_tree_and_ctx = parsed.tree_and_context
    kernel_impl.transform_tree = parsed.transform
    kernel_impl._inside_class = _inside_class
    return True


def _position(self: Any, node: Any) -> str:
    """Where a node is, for messages."""
    return f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}:\n'


def _caller(stacklevel: int = 1) -> str:
    """Where something was made, for messages."""
    frame = sys._getframe(stacklevel + 1)
    return f'File "{frame.f_code.co_filename}", line {frame.f_lineno}, in {frame.f_code.co_name}'


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Whether a decorator stands in a class: its frame is one below the one whose source Taichi would read."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


class _Source:
    """The source of one function, and trees of it that no inlining uses at the moment."""

    def __init__(self, kernel_impl: Any, function: Any) -> None:
        code = function.__code__
        self.file, self.start = code.co_filename, code.co_firstlineno
        end = max(last for _, last, _, _ in code.co_positions() if last is not None)
        lines = linecache.getlines(self.file)[self.start - 1 : end]
        if not lines:  # not from a file
            self.file = kernel_impl.getsourcefile(function)
            lines, self.start = kernel_impl.getsourcelines(function)
        self.lines = [line.rstrip().expandtabs(4) for line in lines]
        self.free: list[ast.Module] = []

    def tree(self) -> ast.Module:
        """A tree of the function without its decorators."""
        if self.free:
            return self.free.pop()
        tree = ast.parse(textwrap.dedent("\n".join(self.lines)))
        tree.body[0].decorator_list = []  # type: ignore[attr-defined]
        return tree


class _Parsed:
    """Sources of all functions that kernels are made of; stands in for two functions of Taichi's ``kernel_impl``."""

    def __init__(self, kernel_impl: Any) -> None:
        self._kernel_impl, self._transform = kernel_impl, kernel_impl.transform_tree
        self._sources: dict[Any, _Source] = {}
        self._attributes: dict[ast.Module, list[ast.Attribute]] = {}

    def tree_and_context(
        self,
        function: Any,
        excluded_parameters: Any = (),
        is_kernel: bool = True,
        arg_features: Any = None,
        args: Any = None,
        ast_builder: Any = None,
        is_real_function: bool = False,
    ) -> tuple[ast.Module, Any]:
        """The tree of a kernel or function, and what Taichi knows at its beginning; in place of ``_get_tree_and_ctx``."""
        if function.func not in self._sources:
            self._sources[function.func] = _Source(self._kernel_impl, function.func)
        source = self._sources[function.func]
        global_vars = self._kernel_impl._get_global_vars(function.func)
        if is_kernel or is_real_function:
            for i in function.template_slot_locations:
                global_vars[function.arguments[i].name] = args[i]
        context = self._kernel_impl.ASTTransformerContext(
            excluded_parameters=excluded_parameters,
            is_kernel=is_kernel,
            func=function,
            arg_features=arg_features,
            global_vars=global_vars,
            argument_data=args,
            src=source.lines,
            start_lineno=source.start,
            file=source.file,
            ast_builder=ast_builder,
            is_real_function=is_real_function,
        )
        return source.tree(), context

    def transform(self, tree: ast.Module, context: Any) -> Any:
        """Carry out a function on the kernel that is being made; in place of ``transform_tree``."""
        if context.is_kernel or context.is_real_function:  # these lose their arguments on the way
            with no_collection():
                return self._transform(tree, context)
        result = self._transform(tree, context)
        if tree not in self._attributes:
            self._attributes[tree] = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
        for node in self._attributes[tree]:
            node.__dict__.pop("caller", None)  # which Taichi takes for granted where there is one
        self._sources[context.func.func].free.append(tree)
        return result

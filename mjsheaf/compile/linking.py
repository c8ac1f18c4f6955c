"""Functions that only compiled code calls: linked into their callers, and translated to machine code there alone.

numba optimises every function, with all that it calls, translates it to machine code, and wraps it for calls from
Python, even where it is only ever called by another compiled function, whose code has a copy of it. Where functions
call each other through several levels, that is most of the time of compilation. Here a function that is called by
compiled code keeps its intermediate code, and the function that Python calls is optimised and translated as a whole.
The extension point is numba's `pipeline_class`.
"""

from contextlib import suppress
from typing import Any

import llvmlite.binding as llvm
from numba import njit
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult

from mjsheaf.compile.machine_code import StoredCode, keep_code


class _EntryLibrary(JITCodeLibrary):
    """Code of a function that Python calls, optimised once all that it calls is linked in.

    Most of its own is what takes the arguments' numbers out of Python's objects. Not optimising that by itself first
    saves a tenth to a fifth of the time that the function takes.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class LinkedLibrary(JITCodeLibrary):
    """Intermediate code of a function and of all that it calls, without machine code."""

    def finalize(self) -> None:
        """Link the code of all that the function calls, so that a caller links this library alone."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        # Level 1: the function that Python calls is optimised as a whole. Loops that were unrolled or turned into
        # vector code before they are inlined take longer to compile, and 3 to 5 % longer to run.
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager(opt=1)
                passes.run(function, builder)

    def get_pointer_to_function(self, name: str) -> int:
        """Return the null pointer: there is no machine code that Python could call."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "LinkedLibrary":
        """The library itself, because it is here that numba sets the environment of machine code."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Set nothing: environments belong to machine code."""

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Return the name and the intermediate code, for the cache on disk."""
        return self.name, self._get_module_for_linking().as_bitcode()

    @classmethod
    def from_bitcode(cls, codegen: Any, name: str, bitcode: bytes) -> "LinkedLibrary":
        """Return the library of which the cache has the intermediate code."""
        library = cls(codegen, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalized = True
        return library


class _ApartLibrary(LinkedLibrary):
    """Intermediate code of a function that callers do not inline."""

    def _optimize_functions(self, ll_module: Any) -> None:
        super()._optimize_functions(ll_module)
        for function in ll_module.functions:
            if not function.is_declaration:
                function.add_function_attribute("noinline")


class EntryCompiler(Compiler):
    """Compiler of the functions that Python calls."""

    library: type[JITCodeLibrary] = _EntryLibrary

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, with a library of this compiler's kind."""
        self.state.library = self.library(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


class _LinkedCompiler(EntryCompiler):
    library = LinkedLibrary


class _ApartCompiler(EntryCompiler):
    library = _ApartLibrary


class _LinkedCacheImpl(CompileResultCacheImpl):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return super().get_filename_base(fullname, abiflags) + ".linked"

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        libdata, fndesc, environment, signature, objectmode, lifted, annotation, reload_init, _ = payload
        library = LinkedLibrary.from_bitcode(target_context.codegen(), *libdata)
        fields: dict[str, Any] = {
            "typing_context": target_context.typing_context,
            "target_context": target_context,
            "entry_point": target_context.get_executable(library, fndesc, environment),
            "typing_error": None,
            "type_annotation": annotation,
            "signature": signature,
            "objectmode": objectmode,
            "lifted": lifted,
            "fndesc": fndesc,
            "library": library,
            "call_helper": None,
            "environment": environment,
            "metadata": None,
            "reload_init": reload_init,
            "referenced_envs": [],
        }
        return CompileResult(**fields)


class _LinkedCache(StoredCode):
    _impl_class = _LinkedCacheImpl


def linked(function: Any, apart: bool, **options: Any) -> Any:
    """Return the dispatcher of a function for calls by compiled code, which do not inline it if it is `apart`."""
    without: dict[str, Any] = {**options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    dispatcher: Any = njit(pipeline_class=_ApartCompiler if apart else _LinkedCompiler, **without)(function)
    with suppress(RuntimeError):  # no directory can be written
        keep_code(dispatcher, _LinkedCache(function), "linked")
    return dispatcher

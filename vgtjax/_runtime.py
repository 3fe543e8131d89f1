"""Settings of JAX and NumPy that make this library fast on a CPU, applied only when asked."""

import os
import pathlib

import jax
import threadpoolctl

from . import _kept

# XLA compiles a loop over scalars natively only below 1 kB of data touched; a march over a trace touches more. Without
# this, every arithmetic group of every step is a dispatched kernel: 27 ms for a 10 s trace instead of 3 ms.
_NATIVE_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"
# Twice the lanes a vector instruction, where the processor has them: a tenth to a quarter of a batch's time.
_WIDE_VECTORS = "--xla_cpu_prefer_vector_width=512"
# LLVM's own code of fused loops instead of MLIR's: the same bits in the same time, and a fifth of a first fit's
# compilation less. Later XLA has no other, and ends a process that asks for it.
_LLVM_LOOPS = ("--xla_cpu_use_fusion_emitters=false",) if jax.__version_info__ < (0, 11) else ()
# A device waits for the others where lanes come together; on a busy machine one that makes a turbine's table takes
# longer than the 40 s after which XLA ends the process.
_PATIENT = "--xla_cpu_collective_call_terminate_timeout_seconds=3600"
_SILENT = "--xla_cpu_collective_call_warn_stuck_timeout_seconds=3600"
_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
_LOCATIONS = "JAX_TRACEBACK_IN_LOCATIONS_LIMIT"
_FORCED = "--xla_force_host_platform_device_count"


def _usable_cores() -> int:
    """Cores that this process may use; a container or a scheduler often allows fewer than there are."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _limit_blas() -> None:
    """One thread of BLAS, in this process and in those that it begins.

    Matrices here are tall and narrow: a second thread gains nothing, and where simulations keep the cores busy it only
    waits for the first.
    """
    if not any(name in os.environ for name in _BLAS_THREADS):
        threadpoolctl.threadpool_limits(limits=1, user_api="blas")
        os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of SciPy's, which is loaded when it is first asked for


def configure(*, x64: bool = True, cpu_devices: int | None = None, cache: str | os.PathLike[str] | None = None) -> None:
    """Sets JAX up for calibration: double precision, native loops, one device a core, a persistent cache, no lines of
    source in programs; and NumPy: one thread of BLAS.

    Call it once, before JAX has computed anything; importing `vgtjax` changes no setting. `XLA_FLAGS` that are set
    already are kept, and win, as do `JAX_TRACEBACK_IN_LOCATIONS_LIMIT` and threads of BLAS (`OPENBLAS_NUM_THREADS` or
    its like). Processes that this one begins inherit them: give one with another version of JAX an `XLA_FLAGS` of its
    own.

    **Arguments:**

    - `x64`: double precision, which every fit needs.
    - `cpu_devices`: how many devices JAX sees on the CPU; by default what `XLA_FLAGS` force, or else the number of
      usable cores. Jacobians and sharded batches spread over them.
    - `cache`: folder of what was compiled; none when absent. JAX's own cache is there, and whole programs of marches
      and fits, so that a second run with traces of the same lengths neither traces nor compiles them. Another version
      of this library or of JAX, other settings or another processor make their own. Like any cache of machine code it
      must be a folder that only its user can write to.

    **Raises:** `RuntimeError` when JAX has already started.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    for flag in (_NATIVE_LOOPS, _WIDE_VECTORS, *_LLVM_LOOPS, _PATIENT, _SILENT):
        if flag.split("=")[0] not in flags:
            flags = f"{flags} {flag}".strip()
    os.environ["XLA_FLAGS"] = flags
    try:  # JAX refuses this once it has started, and then the flags above come too late as well
        jax.config.update("jax_num_cpu_devices", cpu_devices or (-1 if _FORCED in flags else _usable_cores()))
    except RuntimeError as error:
        raise RuntimeError("vgtjax.configure() must be called before JAX computes anything; call it first") from error
    _limit_blas()
    jax.config.update("jax_enable_x64", x64)
    # Which lines of Python an operation comes from takes a twentieth of a first fit, a third of what is compiled for
    # two devices; only a profiler of XLA shows it.
    if _LOCATIONS not in os.environ:
        jax.config.update(_LOCATIONS.lower(), 0)
    if cache is not None:
        jax.config.update("jax_compilation_cache_dir", str(pathlib.Path(cache)))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
        _kept.FOLDER = pathlib.Path(cache) / "programs"

"""One loaded unit that simulates runs, one after the other. This is where its native code is run."""

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from drivers.errors import ConfigError
from sim_backends.fmu.library import fmpy
from sim_backends.fmu.unit import Place
from sim_backends.models.interface import Array

Fixed: TypeAlias = tuple[str, int, float | int | bool | str]
"""Type, value reference and value of a parameter that is the same in all simulations."""

FATAL = 4
"""Status after which an instance must not be touched."""
INTEGERS = ("Integer", "Enumeration", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Value references of the variables that a simulation uses.

    Attributes:
        settings: Set before each simulation.
        inputs: Set at each sample.
        outputs: Read at each sample.
        fixed: Set before each simulation, always the same.
        is_reset: One instance is reset for each simulation; otherwise each makes a new one.
    """

    settings: tuple[int, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    fixed: tuple[Fixed, ...] = ()
    is_reset: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One simulation.

    Attributes:
        settings: Values of the settings.
        inputs: Inputs x samples.
        count: Number of samples.
        step_s: Between samples.
        substeps: Communication steps per sample.
        is_held: Inputs keep their value until the next sample; otherwise straight lines.
    """

    settings: tuple[float, ...]
    inputs: Array
    count: int
    step_s: float
    substeps: int
    is_held: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Outputs x samples, NaN from a failure on, and what failed; empty for nothing."""

    outputs: Array
    failure: str = ""


class _EndedError(Exception):
    """The unit ended the simulation."""


class Instance(ABC):
    """A unit for co-simulation, loaded into this process."""

    def __init__(self, place: Place, layout: Layout) -> None:
        self._place = place
        self._layout = layout
        self._messages: list[str] = []
        self._unit: Any = None
        self._references = [_references(one) for one in (layout.settings, layout.inputs, layout.outputs)]
        self._buffers = [
            (ctypes.c_double * len(one))() for one in (layout.settings, layout.inputs, layout.outputs)
        ]
        # Numpy arrays in the same memory: copies into and out of ctypes are slow.
        self._values = [
            np.frombuffer(memoryview(one), np.float64) if len(one) else np.zeros(0) for one in self._buffers
        ]

    def simulate(self, job: Job) -> Result:
        """Simulate one run from its beginning.

        Raises:
            ConfigError: The unit cannot be loaded.
        """
        outputs = np.full((job.count, len(self._layout.outputs)), np.nan)
        inputs = np.ascontiguousarray(job.inputs.T)
        sample = 0
        self._messages.clear()
        if self._unit is None or not self._layout.is_reset:
            self._renew()
        try:
            self._begin(job)
            for sample in range(job.count):
                self._set_inputs(inputs[sample])
                self._read()
                outputs[sample] = self._values[2]
                if sample + 1 < job.count:
                    self._advance(job, inputs, sample)
            self._unit.terminate()
        except _EndedError as error:
            return self._failed(outputs, str(error), sample, job)
        except fmpy("fmi1").FMICallException as error:
            if error.status == FATAL:
                self._unit = None
            return self._failed(outputs, " ".join(str(error).split()), sample, job)
        bad = np.flatnonzero(~np.isfinite(outputs).all(axis=1))
        if bad.size:
            outputs[bad[0] :] = np.nan
            return self._failed(outputs, "it returns values that are not finite", int(bad[0]), job)
        return Result(outputs=outputs.T)

    def _failed(self, outputs: Array, why: str, sample: int, job: Job) -> Result:
        """Return what there is of a simulation, and drop the instance."""
        self.close()
        said = f" ({self._messages[-1]})" if self._messages else ""
        return Result(outputs=outputs.T, failure=f"at {sample * job.step_s:.4g} s {why.rstrip('.')}{said}")

    def _advance(self, job: Job, inputs: Array, sample: int) -> None:
        width = job.step_s / job.substeps
        here, there = inputs[sample], inputs[sample + 1]
        for substep in range(job.substeps):
            if not job.is_held:
                self._set_inputs(here + (there - here) * (substep + 0.5) / job.substeps)
            self._step(sample * job.step_s + substep * width, width)

    def _set_inputs(self, values: Array) -> None:
        if values.size:
            self._values[1][:] = values
            self._write(self._references[1], self._buffers[1])

    def _renew(self) -> None:
        """Load the unit, or make a new instance of it.

        Raises:
            ConfigError: It cannot be loaded.
        """
        self.close()
        try:
            self._unit = self._made()
        except Exception as error:
            said = f" ({self._messages[-1]})" if self._messages else ""
            raise ConfigError(
                f"the unit {self._place.identifier} cannot be loaded: {' '.join(str(error).split())}{said}"
            ) from error
        self._is_new = True

    def _begin(self, job: Job) -> None:
        if not self._is_new:
            self._unit.reset()
        self._is_new = False
        self._values[0][:] = job.settings
        self._initialise(job.count * job.step_s, job)

    def _set_parameters(self) -> None:
        for kind, reference, value in self._layout.fixed:
            getattr(self._unit, f"set{self._setter(kind)}")([reference], [value])
        if len(self._references[0]):
            self._write(self._references[0], self._buffers[0])

    def close(self) -> None:
        """Free the instance; the shared library stays loaded."""
        unit, self._unit = self._unit, None
        if unit is not None:
            self._free(unit)

    def _remember(self, message: object) -> None:
        text = message.decode("utf-8", "replace") if isinstance(message, bytes) else str(message)
        self._messages.append(" ".join(text.split())[:300])

    def _arguments(self) -> dict[str, str]:
        return {
            "guid": self._place.token,
            "modelIdentifier": self._place.identifier,
            "unzipDirectory": self._place.folder,
            "instanceName": self._place.identifier,
            "libraryPath": self._place.library,
        }

    @abstractmethod
    def _made(self) -> Any: ...

    @abstractmethod
    def _free(self, unit: Any) -> None: ...

    @abstractmethod
    def _initialise(self, duration_s: float, job: Job) -> None: ...

    @abstractmethod
    def _write(self, references: Any, values: Any) -> None: ...

    @abstractmethod
    def _read(self) -> None: ...

    @abstractmethod
    def _step(self, time_s: float, width_s: float) -> None: ...

    @staticmethod
    @abstractmethod
    def _setter(kind: str) -> str: ...


class Instance2(Instance):
    """A unit of FMI 2."""

    def _made(self) -> Any:
        library = fmpy("fmi2")

        def log(environment: Any, name: Any, status: int, category: Any, message: bytes) -> None:
            self._remember(message)

        callbacks = library.fmi2CallbackFunctions()
        callbacks.logger = library.fmi2CallbackLoggerTYPE(log)
        callbacks.allocateMemory = library.defaultCallbacks.allocateMemory
        callbacks.freeMemory = library.defaultCallbacks.freeMemory
        unit = library.FMU2Slave(**self._arguments())
        unit.instantiate(callbacks=callbacks, loggingOn=False)
        return unit

    def _free(self, unit: Any) -> None:
        unit.fmi2FreeInstance(unit.component)

    def _initialise(self, duration_s: float, job: Job) -> None:
        self._unit.setupExperiment(startTime=0.0, stopTime=duration_s)
        self._set_parameters()
        self._unit.enterInitializationMode()
        self._set_inputs(job.inputs[:, 0])
        self._unit.exitInitializationMode()

    def _write(self, references: Any, values: Any) -> None:
        self._unit.fmi2SetReal(self._unit.component, references, len(references), values)

    def _read(self) -> None:
        references, values = self._references[2], self._buffers[2]
        self._unit.fmi2GetReal(self._unit.component, references, len(references), values)

    def _step(self, time_s: float, width_s: float) -> None:
        self._unit.fmi2DoStep(self._unit.component, time_s, width_s, 1)

    @staticmethod
    def _setter(kind: str) -> str:
        return "Integer" if kind == "Enumeration" else kind


class Instance3(Instance):
    """A unit of FMI 3."""

    def _made(self) -> Any:
        def log(environment: Any, status: int, category: Any, message: bytes) -> None:
            self._remember(message)

        unit = fmpy("fmi3").FMU3Slave(**self._arguments())
        unit.instantiate(logMessage=log, loggingOn=False)
        return unit

    def _free(self, unit: Any) -> None:
        unit.fmi3FreeInstance(unit.component)

    def _initialise(self, duration_s: float, job: Job) -> None:
        self._set_parameters()
        self._unit.enterInitializationMode(startTime=0.0, stopTime=duration_s)
        self._set_inputs(job.inputs[:, 0])
        self._unit.exitInitializationMode()

    def _write(self, references: Any, values: Any) -> None:
        self._unit.fmi3SetFloat64(self._unit.component, references, len(references), values, len(references))

    def _read(self) -> None:
        references, values = self._references[2], self._buffers[2]
        self._unit.fmi3GetFloat64(self._unit.component, references, len(references), values, len(references))

    def _step(self, time_s: float, width_s: float) -> None:
        _, is_over, is_early, _ = self._unit.doStep(time_s, width_s)
        if is_over or is_early:
            raise _EndedError("it ends the simulation")

    @staticmethod
    def _setter(kind: str) -> str:
        return "Int64" if kind == "Enumeration" else kind


def load(place: Place, layout: Layout) -> Instance:
    """Return a unit for this process; it is loaded with its first simulation."""
    return (Instance2 if place.version == 2 else Instance3)(place, layout)


def _references(values: Sequence[int]) -> Any:
    return (ctypes.c_uint32 * len(values))(*values)

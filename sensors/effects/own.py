"""Effects of one's own, without a clone: declared in a script, in a file (`--effects`), or by an installed package.

A file is named in the environment variable `SINAN_EFFECTS`, so that every worker process finds it too. A package
declares an entry point of the group `sinan.effects` whose object is an `Effect`, or several in a list.
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from sinan.sensors.effects.declaration import Effect, Exact, Parameter, Regressor
from sinan.sensors.effects.shipped import is_shipped
from sinan.sensors.errors import InputError
from sinan.sensors.files import resolved

#: Files of effects, separated as the system separates paths.
VARIABLE = "SINAN_EFFECTS"
#: Entry points of packages that bring effects.
GROUP = "sinan.effects"
#: Sensors whose readings an effect of one's own may enter.
STREAMS = ("accel", "gyro", "mag", "baro", "sonar", "laser", "gps", "base")
#: What an effect may need, by the names in `Motion` and its covariates.
KNOWN = (
    "f_b", "w_ib_b", "dw_b", "m_b", "m_n", "q_nb", "p_n", "v_n", "temperature", "current", "voltage", "throttle",
    "airspeed", "wind", "vibration", "rotor_drag",
)  # fmt: skip
#: Which recordings.
KINDS = ("flight", "poses")

_OWN: dict[str, Effect] = {}
_READ: dict[Path, tuple[str, tuple[str, ...]]] = {}  # files, what they held, and the names that they declared


def effect(
    name: str,
    regressor: Regressor | None = None,
    *,
    parameters: Mapping[str, tuple[str, float]] | Sequence[Parameter],
    needs: Sequence[str] = (),
    enters: str = "",
    summary: str = "",
    physics: str = "",
    source: str = "",
    kinds: Iterable[str] = ("flight",),
    exact: Exact | None = None,
    separates: str = "",
    in_field_units: bool = False,
) -> Effect | Callable[[Regressor], Effect]:
    """Declare an effect of your own: from then on it is simulated, estimated where it is declared, and traced.

    Parameters
    ----------
    name : `sensor.effect`, such as `baro.suction`; the sensor is the stream whose reading it enters
    regressor : (motion) -> (n, size of a reading, parameters): d reading / d beta at beta = 0, SI units; without it
        `effect` is a decorator of that function
    parameters : by name, unit and plausible 1-sigma size in instruments that are sold
    needs : quantities that have to be known: of the motion (f_b, w_ib_b, dw_b, m_b, m_n, q_nb, p_n, v_n), or
        covariates (temperature, current, voltage, throttle, airspeed, wind, vibration)
    enters : how it changes the reading, as an equation
    summary, physics : the instrument's error in one sentence, and its cause; default: the function's docstring
    source : reference
    kinds : "flight", "poses": kinds of recording in which it is a candidate
    exact : (plain reading, beta, motion, model) -> reading, where it is not linear in beta
    separates : the manoeuvre that makes it observable
    in_field_units : the parameters scale with the unit of the magnetic field

    Returns
    -------
    Effect

    Raises
    ------
    InputError : a name that is in use or names no sensor; no parameter; needs that no recording can have

    Examples
    --------
    >>> import sinan
    >>> @sinan.effect("baro.suction", parameters={"b": ("m", 3.0)}, needs=["throttle"], enters="h += b x throttle")
    ... def suction(motion):
    ...     '''The rotors draw air out of the barometer's canopy.'''
    ...     return motion.covariates["throttle"][:, None, None]
    >>> flight = sinan.simulate("hover", seed=1, effects={"baro.suction": [2.5]})
    >>> read_too_high = flight.streams["baro"]["height"] - sinan.simulate("hover", seed=1).streams["baro"]["height"]
    >>> bool(0.5 < read_too_high.mean() < 2.5)
    True
    """

    def declared(function: Regressor) -> Effect:
        said = (inspect.getdoc(function) or "").partition("\n")
        entries = tuple(parameters) if not isinstance(parameters, Mapping) else _parameters(name, parameters)
        return add(
            Effect(
                name=name,
                stream=name.split(".")[0],
                summary=summary or said[0] or f"{name}.",
                enters=enters or "reading += G beta",
                physics=physics or " ".join(said[2].split()),
                source=source or "declared by the user",
                parameters=entries,
                needs=tuple(needs),
                regressor=function,
                exact=exact,
                kinds=frozenset(kinds),
                separates=separates,
                in_field_units=in_field_units,
            )
        )

    return declared if regressor is None else declared(regressor)


def _parameters(name: str, parameters: Mapping[str, tuple[str, float]]) -> tuple[Parameter, ...]:
    made = []
    for key, entry in parameters.items():
        try:
            unit, plausible = entry
            made.append(Parameter(key, str(unit), float(plausible)))
        except (TypeError, ValueError):
            expected = 'the unit and a plausible 1-sigma size, such as ("m", 3.0)'
            raise InputError(f"effect {name}", repr(entry), expected, f"parameters {key}") from None
    return tuple(made)


def add(entry: Effect) -> Effect:
    """Put an effect among those that are known; declared a second time it takes the place of the first.

    Raises
    ------
    InputError : see `effect`
    """
    where = f"effect {entry.name}"
    stream, dot, word = entry.name.partition(".")
    if not (dot and word.isidentifier() and stream == entry.stream and stream in STREAMS):
        near = get_close_matches(stream, STREAMS, n=1)
        raise InputError(
            where, f"a name of stream `{entry.stream}`", "SENSOR.WORD with a sensor of " + ", ".join(near or STREAMS)
        )
    if is_shipped(entry.name):
        raise InputError(where, "a name that is taken", "another name: `sinan effects` lists those that are taken")
    if not entry.parameters or not all(0.0 < one.plausible < float("inf") for one in entry.parameters):
        raise InputError(where, "no parameter with a plausible size", "one or more, each with a positive size")
    unknown = [need for need in entry.needs if need not in KNOWN]
    if unknown:
        raise InputError(where, f"needs {', '.join(unknown)}", "some of " + ", ".join(KNOWN))
    if not entry.kinds or not set(entry.kinds) <= set(KINDS):
        raise InputError(where, f"kinds {', '.join(sorted(entry.kinds)) or 'none'}", " or ".join(KINDS))
    _OWN[entry.name] = entry
    return entry


def remove(name: str) -> None:
    """Forget an effect of one's own."""
    _OWN.pop(name, None)


def own_effects() -> Mapping[str, Effect]:
    """Effects of one's own by name: declared in this process, in the files of `SINAN_EFFECTS`, and by packages.

    Raises
    ------
    InputError : a file or a package that cannot be read; names it
    """
    for path in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        _read(Path(path))
    _of_packages()
    return _OWN


def read_file(path: Path) -> tuple[str, ...]:
    """Read a Python file that declares effects, here and in every process that this one starts; their names.

    Raises
    ------
    InputError : no such file; an error in it; no effect in it
    """
    whole = resolved(path)
    names = _read(whole)
    known = os.environ.get(VARIABLE, "")
    if str(whole) not in known.split(os.pathsep):
        os.environ[VARIABLE] = os.pathsep.join(filter(None, [known, str(whole)]))
    return names


def _read(path: Path) -> tuple[str, ...]:
    """Run a file once, and again when it has changed; the names that it declares."""
    try:
        content = sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", "a Python file that declares effects") from None
    if path in _READ and _READ[path][0] == content:
        return _READ[path][1]
    name = f"sinan_effects_{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(path, "no Python file", "a file that ends in .py")
    module = module_from_spec(spec)
    sys.modules[name] = module  # so that what it defines can be sent to a worker
    known = dict(_OWN)
    try:
        spec.loader.exec_module(module)
        for value in vars(module).values():
            for entry in value if isinstance(value, list | tuple) else [value]:
                if isinstance(entry, Effect) and _OWN.get(entry.name) is not entry:
                    add(entry)
    except InputError as error:
        raise InputError(path, f"{error}", "effects that can be declared") from None
    except (Exception, SystemExit) as error:
        raise InputError(path, f"{type(error).__name__}: {error}", "a file that runs to its end") from error
    names = tuple(sorted(name for name, entry in _OWN.items() if known.get(name) is not entry))
    if not names:
        raise InputError(path, "no effect", "at least one call of `sinan.effect`, or an `Effect`")
    _READ[path] = content, names
    return names


_packages_read = False


def _of_packages() -> None:
    """The effects of installed packages, once."""
    global _packages_read
    if _packages_read:
        return
    _packages_read = True
    for point in entry_points(group=GROUP):
        for entry in _loaded(point):
            if entry.name not in _OWN:
                add(entry)


def _loaded(point: EntryPoint) -> list[Effect]:
    package = point.dist.name if point.dist is not None else point.value
    where = f"package {package}, entry point {point.name} of {GROUP}"
    try:
        found = point.load()
    except Exception as error:
        raise InputError(where, f"{type(error).__name__}: {error}", "an effect, or the package uninstalled") from None
    entries = [found] if isinstance(found, Effect) else list(found) if isinstance(found, list | tuple) else []
    if not entries or not all(isinstance(entry, Effect) for entry in entries):
        raise InputError(where, f"{type(found).__name__}", "an `Effect`, or a list of them")
    return entries

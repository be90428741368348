"""Tables of README.md, written from the families themselves."""

from tests.nature.machines.case import Effect, Term
from tests.nature.machines.family import Family


def family_tables(family: Family) -> str:
    """Return the tables of a family as Markdown: parameters, states, inputs, channels, effects, terms."""
    parts = [
        f"Sample time {family.dt_s:g} s. A broad case adds its force to the equation of "
        f"`{family.disturbance.equation}`, in {family.disturbance.unit} (correlation time "
        f"{family.disturbance.correlation_s:g} s).",
        _table(
            ("parameter", "nominal", "spread", "from run to run", "meaning"),
            [
                (
                    f"`{one.name}`",
                    f"{one.nominal:g}",
                    _percent(one.spread),
                    _percent(one.scatter),
                    one.meaning,
                )
                for one in family.parameters
            ],
        ),
        _table(
            ("state", "true start about `start_<state>`, standard deviation"),
            [(f"`{one.name}`", f"{one.spread:g}") for one in family.states],
        ),
        _table(
            ("input", "from", "to"),
            [(f"`{one.name}`", f"{one.low:g}", f"{one.high:g}") for one in family.inputs],
        ),
        _table(
            ("channel", "noise sigma", "quantum"),
            [(f"`{one.name}`", f"{one.sigma:g}", f"{one.quantum:.6g}") for one in family.channels],
        ),
        _table(
            ("effect of the catalogue", "formula", "size: without to largest", "drawn"),
            [_effect_row(one) for one in family.catalogue],
        ),
        _table(
            (
                "outside the catalogue",
                "formula",
                "equation",
                "variables",
                "shape",
                "sign",
                "coefficient up to",
                "drawn",
            ),
            [_term_row(one) for one in family.outside],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _effect_row(effect: Effect) -> tuple[str, ...]:
    sign = ", either sign" if effect.signed else ""
    size = ", ".join(f"`{name}` {low:g} to {high:g}{sign}" for name, (low, high) in effect.size.items())
    return f"`{effect.name}`", _cell(effect.formula), size, _drawn(effect)


def _term_row(term: Term) -> tuple[str, ...]:
    variables = ", ".join(f"`{name}`" for name in term.variables)
    return (
        f"`{term.name}`", _cell(term.formula), f"`{term.equation}`", variables, term.shape, f"{term.sign:+d}",
        f"`{term.coefficient}` {term.largest:g}", _drawn(term),
    )  # fmt: skip


def _drawn(effect: Effect | Term) -> str:
    return ", ".join(f"`{name}` {low:g} to {high:g}" for name, (low, high) in effect.drawn.items())


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _percent(share: float) -> str:
    return f"{100 * share:g} %" if share else "exact"


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)

"""Reads `study.toml`: what is compared, where, by how many, with which forms and measures.

Everything is declared once, below; reading, errors and the tables of docs/studies.md follow from
it. `read_study` also refuses studies that cannot be evaluated: conditions or layouts in unbalanced
orders, layouts of unequal difficulty, measures that do not exist.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from usarsim_mission.scenario.policies import PRESENT_POLICIES, read_policy
from usarsim_server.base.errors import at
from usarsim_server.base.fields import field
from usarsim_server.base.files import is_folder, is_regular
from usarsim_server.base.tables import Table, nearest, suggest
from usarsim_server.base.toml import parse_toml, read_text
from usarsim_study import instruments
from usarsim_study.assignment import ALLOCATION, Allocation, Cell, Design, Order, imbalance, orders
from usarsim_study.errors import StudyError
from usarsim_study.forms import Form, Item
from usarsim_study.lines import telling_lines
from usarsim_study.measures import names as measure_names
from usarsim_study.misread import misread

FILE = "study.toml"
SHIPPED = Path(__file__).parent / "studies"
"""Folder of the studies that come along."""
ALIKE = 0.10
"""Layouts may differ by this share in the length of the way and in occlusion."""
LONGEST_PAGE = 10_000
"""Characters of a welcome, or of a consent."""
PROBES = 3
"""Freeze probes of a trial at most."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")


def _name(table: Table, key: str) -> str:
    name = table.text(key)
    if not _NAME.fullmatch(name):
        if taken := misread(name):
            raise table.error(key, *_misread(name, taken))
        raise table.wrong(key, name, "a name", "letters, digits, _ and -, a letter first")
    return name


def _paragraphs(table: Table, key: str) -> str:
    """A text of one line or several."""
    text = table.raw(key)
    if not isinstance(text, str):
        raise table.wrong(key, text, "a text", 'it in quotes, or in """ if it has several lines')
    if len(text) > LONGEST_PAGE:
        raise table.error(key, f"has {len(text)} characters", f"write at most {LONGEST_PAGE}")
    if not all(one.isprintable() or one == "\n" for one in text):
        raise table.error(key, "has control characters", "write lines of printable text")
    return text


def _misread(name: str, taken: str) -> tuple[str, str]:
    """Problem and cure of a name that programs for statistics do not read as a word."""
    problem = f"pandas reads {name!r} in a table as {taken}, quoted or not"
    return problem, "choose another name, such as one that says what it is"


def _unattended(table: Table, key: str) -> str:
    return "mission" if table.text(key) == "mission" else read_policy(table, key)


@dataclass(frozen=True, slots=True)
class Condition:
    """One of the things that are compared."""

    name: str = field(parse=_name, expects="a name", help="in tables and files")
    label: str = field(default="", help="what participants and reports call it; default its name")
    device: Literal["any", "keyboard", "gamepad"] = field(
        default="any", help="the only device that drives"
    )
    panel: Literal["full", "classic"] = field(
        default="full", help="`classic`: pictures and laser only, as in the paper"
    )
    mission: str = field(default="", help="mission instead of that of the layout")
    robots: int | None = field(
        default=None, low=1, high=64, help="the first so many robots of the mission; default all"
    )
    unattended: str = field(
        default="mission",
        parse=_unattended,
        expects=f"mission, {', '.join(PRESENT_POLICIES)}, or a policy of a package",
        help="what robots do that nobody drives; `mission`: as its file says",
    )
    impair: str = field(default="", help="file with the links' delay, jitter, loss, bandwidth")
    operators: Literal["one", "pooled", "split"] = field(
        default="one",
        help="one person, two who share all robots, or two with half of the robots each",
    )

    @property
    def title(self) -> str:
        """What people read."""
        return self.label or self.name


@dataclass(frozen=True, slots=True)
class Layout:
    """A place with its victims."""

    name: str = field(parse=_name, expects="a name", help="in tables and files")
    mission: str = field(
        default="",
        help="mission file, from the folder of the study file, or the name of a shipped one; may "
        "be absent where every condition has its own",
    )
    seed: int | None = field(
        default=None, low=0, high=2**31, help="of the mission, so of where its victims are"
    )
    path_length: float | None = field(
        default=None,
        above=0.0,
        unit="m",
        help="mean way from the starts to the victims; default: `check` measures it",
    )
    occlusion: float | None = field(
        default=None, low=0.0, high=1.0, help="share of the floor that sees no victim"
    )


@dataclass(frozen=True, slots=True)
class Training:
    """What a participant has to do before the first trial, with each device."""

    mission: str = field(help="mission file, or the name of a shipped one: `slalom`")
    contacts: int = field(default=2, low=0, high=1000, help="at most so many collisions")
    victims: int = field(default=2, low=0, high=1000, help="at least so many marked rightly")
    attempts: int = field(default=5, low=1, high=100, help="then the participant is excluded")
    text: str = field(
        default="",
        parse=_paragraphs,
        expects="a text",
        help="what participants read before it and above the panel: what is where, what to do",
    )


@dataclass(frozen=True, slots=True)
class Choice:
    """An answer to choose."""

    name: str = field(parse=_name, expects="a name", help="in tables and files")
    text: str = field(help="what is shown")


@dataclass(frozen=True, slots=True)
class ItemEntry:
    """A question of a questionnaire of one's own."""

    name: str = field(parse=_name, expects="a name", help="in tables and files")
    text: str = field(help="what is asked")
    kind: Literal["scale", "choice", "text", "flag"] = field(
        default="scale", help="`flag`: yes or no; what is typed as `text` is never exported"
    )
    low: float = field(default=1.0, help="of a scale")
    high: float = field(default=7.0, help="of a scale")
    step: float = field(default=1.0, above=0.0, help="of a scale")
    left: str = field(default="", help="word at its low end")
    right: str = field(default="", help="word at its high end")
    choice: tuple[Choice, ...] = field(default=(), help="answers to choose from")
    required: bool = field(default=True, help="the next page waits for it")
    page: int = field(default=1, low=1, high=50, help="on which it stands")

    def item(self) -> Item:
        """As a form has it."""
        return Item(
            self.name,
            self.text,
            self.kind,
            self.low,
            self.high,
            self.step,
            self.left,
            self.right,
            tuple((one.name, one.text) for one in self.choice),
            self.required,
            self.page,
        )


FormKind = Literal["nasa-tlx", "nasa-tlx-weighted", "sus", "sart", "preference", "questionnaire"]
When = Literal["before", "after_trial", "after"]


@dataclass(frozen=True, slots=True)
class FormEntry:
    """A form, and when it is filled in."""

    name: str = field(parse=_name, expects="a name", help="in tables and files")
    kind: FormKind = field(help="`questionnaire`: the items below it")
    when: When = field(help="before the first trial, after each, or after the last")
    title: str = field(default="", help="of a questionnaire")
    instructions: str = field(default="", help="of a questionnaire")
    item: tuple[ItemEntry, ...] = field(default=(), help="items of a questionnaire")


@dataclass(frozen=True, slots=True)
class Probe:
    """A question about the situation while the world stands still and the page is blank."""

    at: float = field(above=0.0, unit="s", help="simulated time since the trial began")
    question: Literal["nearest_to_last_mark", "where_is", "victims_marked", "moving"] = field(
        help="what is asked"
    )
    robot: int = field(default=1, low=1, high=64, help="of `where_is`, `moving`: which one")


@dataclass(frozen=True, slots=True)
class Study:
    """A study file."""

    title: str = field(help="of the report")
    seed: int = field(low=0, high=2**31, help="of the assignment")
    participants: int = field(low=1, high=1000, help="planned")
    primary: str = field(help="the measure that decides")
    secondary: tuple[str, ...] = field(default=(), help="further measures, corrected by Holm")
    design: Design = field(default="within", help="each participant meets all conditions, or one")
    blind: bool = field(default=False, help="pages and participants' files name no condition")
    alpha: float = field(default=0.05, above=0.0, high=0.5, help="level of the tests")
    welcome: str = field(
        default="",
        parse=_paragraphs,
        expects="a text",
        help="is shown first; blank lines part paragraphs, as in `consent`",
    )
    consent: str = field(
        default="",
        parse=_paragraphs,
        expects="a text",
        help="what participants agree to before anything else: a text of several lines, or the "
        "name of a text file",
    )
    condition: tuple[Condition, ...] = field(default=(), help="what is compared")
    layout: tuple[Layout, ...] = field(default=(), help="where")
    training: Training | None = field(default=None, help="before the first trial")
    form: tuple[FormEntry, ...] = field(default=(), help="what is filled in")
    probe: tuple[Probe, ...] = field(default=(), help="at most three in a trial")
    orders: tuple[Order, ...] = ()
    """Sequences of trials, all to be used equally often."""

    @property
    def consent_file(self) -> str:
        """Name of the file with the consent; empty: there is none, or the text stands here."""
        return "" if "\n" in self.consent else self.consent

    @property
    def allocation(self) -> Allocation:
        """Who gets which sequence."""
        return Allocation(self.seed, self.orders, self.participants)

    def mission_of(self, cell: Cell) -> tuple[str, int | None]:
        """Name of the mission of a trial, and its seed; None: that of its file."""
        layout = next(one for one in self.layout if one.name == cell.layout)
        return self.condition_named(cell.condition).mission or layout.mission, layout.seed

    def condition_named(self, name: str) -> Condition:
        """A condition."""
        return next(one for one in self.condition if one.name == name)

    def forms(self, when: When, labels: tuple[str, ...] = ()) -> tuple[Form, ...]:
        """The forms of a moment.

        Args:
            when: which moment.
            labels: what a blind study calls its conditions here, in the order of the study file;
                their own titles else.
        """
        found = []
        for entry in self.form:
            if entry.when == when:
                found.append(self._form(entry, labels))
        return tuple(found)

    def form_named(self, name: str) -> Form | None:
        """A form, with the conditions' own titles."""
        return next((self._form(one, ()) for one in self.form if one.name == name), None)

    def form_shown(self, name: str, names: tuple[str, ...], labels: tuple[str, ...]) -> Form:
        """A form as a participant sees it.

        Args:
            name: of it.
            names, labels: what answers and people call the conditions, in the order of the study
                file; empty: by their own names and titles.

        Raises:
            StudyError: there is none.
        """
        for entry in self.form:
            if entry.name == name:
                return self._form(entry, labels, names)
        raise StudyError(f"the study has no form {name!r} (see its [[form]])")

    def _form(self, entry: FormEntry, labels: tuple[str, ...], names: tuple[str, ...] = ()) -> Form:
        if entry.kind == "questionnaire":
            items = tuple(one.item() for one in entry.item)
            return Form(entry.name, entry.kind, entry.title, entry.instructions, items)
        if entry.kind == "preference":
            titles = labels or tuple(one.title for one in self.condition)
            names = names or tuple(one.name for one in self.condition)
            return instruments.preference(entry.name, list(zip(names, titles, strict=True)))
        return instruments.KINDS[entry.kind](entry.name)


def find_study(name: str) -> Path:
    """The file of a study: a path, a study's folder, or the name of a shipped one.

    Raises:
        StudyError: there is none; the message lists the names that would do.
    """
    path = Path(name).expanduser()
    if is_folder(path):
        return path / FILE
    if is_regular(path):
        return path
    shipped = {one.stem: one for one in shipped_studies()}
    if name in shipped:
        return shipped[name]
    raise StudyError(at(path, "no such study", f"{suggest(name, tuple(shipped))} or name a file"))


def shipped_studies() -> tuple[Path, ...]:
    """The files of all studies that come along, by name."""
    return tuple(sorted(SHIPPED.glob("*.toml")))


def begun(folder: Path) -> bool:
    """Whether the study of a folder has begun: its list of assignments is written."""
    return (folder / ALLOCATION).exists()


def read_study(path: Path, out: Path | None = None) -> Study:
    """Read and check a study file.

    Names that programs for statistics do not read as words are refused, unless the study has begun.

    Args:
        path: the file.
        out: the folder of its sessions; None: that of the file.

    Raises:
        StudyError: it cannot be read, says something unknown, or the study would be unbalanced;
            with line, reason and cure.
    """
    text = read_text(path, StudyError)
    table = Table(parse_toml(text, path, StudyError, "condition"), path, StudyError)
    with telling_lines(path, text):
        sequences = _sequences(table)
        study = table.read(Study)
        table.finish()
        _check_names(table, study)
        if not begun(out or path.parent):
            _check_words(table, study)
        _check_forms(table, study)
        _check_measures(table, study)
        _check_layouts(table, study)
        return _ordered(table, study, sequences)


def _sequences(table: Table) -> tuple[tuple[str, ...], ...]:
    """Explicit sequences, `[[sequence]] trials = ["keyboard A", "gamepad B"]`."""
    found = []
    for inner in table.tables("sequence"):
        found.append(inner.texts("trials"))
        inner.finish()
    return tuple(found)


def _check_names(table: Table, study: Study) -> None:
    for key, entries, least in (
        ("condition", study.condition, 2),
        ("layout", study.layout, 1),
        ("form", study.form, 0),
    ):
        if len(entries) < least:
            raise table.error(key, f"{len(entries)} given", f"write at least {least} [[{key}]]")
        names = [one.name for one in entries]
        for number, name in enumerate(names, start=1):
            if name in names[: number - 1]:
                place = f"[[{key}]] {number} ({name}): name"
                raise table.error(place, "is there twice", "give each a name of its own")
    if not all(one.mission for one in study.condition):
        for number, layout in enumerate(study.layout, start=1):
            if not layout.mission:
                place = f"[[layout]] {number} ({layout.name}): mission"
                raise table.error(place, "is missing", 'add mission = "FILE", or to each condition')
    if len(study.probe) > PROBES:
        place = f"[[probe]] {PROBES + 1}: at"
        raise table.error(place, "one probe too many", f"ask at most {PROBES} in a trial")


def words(study: Study) -> list[tuple[str, str]]:
    """Every name of a study that comes into tables, with its place in the file."""
    found = []
    for key, names in (
        ("condition", [one.name for one in study.condition]),
        ("layout", [one.name for one in study.layout]),
    ):
        for number, name in enumerate(names, start=1):
            found.append((f"[[{key}]] {number} ({name}): name", name))
    for number, form in enumerate(study.form, start=1):
        place = f"[[form]] {number} ({form.name})"
        found.append((f"{place}: name", form.name))
        for row, item in enumerate(form.item, start=1):
            where = f"{place}: [[item]] {row} ({item.name})"
            found.append((f"{where}: name", item.name))
            found += [
                (f"{where}: [[choice]] {at} ({choice.name}): name", choice.name)
                for at, choice in enumerate(item.choice, start=1)
            ]
    return found


def _check_words(table: Table, study: Study) -> None:
    for place, name in words(study):
        if taken := misread(name):
            raise table.error(place, *_misread(name, taken))


def _check_forms(table: Table, study: Study) -> None:
    for number, entry in enumerate(study.form, start=1):
        place = f"[[form]] {number} ({entry.name})"
        own = entry.kind == "questionnaire"
        if own != bool(entry.item):
            cure = "write [[form.item]] below it" if own else "remove its items"
            raise table.error(f"{place}: kind", f"{entry.kind} with {len(entry.item)} items", cure)
        if entry.kind == "preference" and (entry.when != "after" or study.design != "within"):
            cure = 'write when = "after", in a study within participants'
            raise table.error(f"{place}: when", "nothing can be compared then", cure)
        names: set[str] = set()
        for row, item in enumerate(entry.item, start=1):
            where = f"{place}: [[item]] {row} ({item.name})"
            if item.name in names:
                raise table.error(f"{where}: name", "is there twice", "choose another name")
            names.add(item.name)
            if item.kind == "scale" and item.low >= item.high:
                raise table.error(f"{where}: low", "is not below high", "write a smaller number")
            if item.kind == "choice" and len(item.choice) < 2:
                cure = "write [[form.item.choice]] below it"
                raise table.error(f"{where}: kind", "has nothing to choose from", cure)


def _check_measures(table: Table, study: Study) -> None:
    known = measure_names()
    for key, names in (("primary", (study.primary,)), ("secondary", study.secondary)):
        for name in names:
            if name not in known:
                close = nearest(name, known)
                cure = suggest(name, known) if close else "see the table of docs/studies.md"
                raise table.error(key, f"{name!r} is no measure", cure)
    if study.primary in study.secondary or len(set(study.secondary)) < len(study.secondary):
        raise table.error("secondary", "names a measure twice", "name each once")


def _check_layouts(table: Table, study: Study) -> None:
    """Layouts must be equally hard (HRI-01)."""
    for key in ("path_length", "occlusion"):
        given = [(one.name, getattr(one, key)) for one in study.layout]
        known = [(name, value) for name, value in given if value is not None]
        if not known:
            continue
        if len(known) < len(given):
            name = next(name for name, value in given if value is None)
            number = [one for one, _ in given].index(name) + 1
            place = f"[[layout]] {number} ({name}): {key}"
            raise table.error(place, "is missing", "give it for every layout or for none")
        least, most = min(known, key=lambda one: one[1]), max(known, key=lambda one: one[1])
        if not alike(least[1], most[1]):
            number = [one for one, _ in given].index(most[0]) + 1
            share = 100.0 * (most[1] - least[1]) / most[1]
            raise table.error(
                f"[[layout]] {number} ({most[0]}): {key}",
                f"{most[1]:g} differs from the {least[1]:g} of {least[0]} by {share:.0f} %",
                f"make layouts that differ by at most {100 * ALIKE:.0f} %",
            )


def alike(less: float, more: float) -> bool:
    """Whether two layouts are equally hard by a figure."""
    return more - less <= ALIKE * more * (1.0 + 1e-9)  # 0.40 and 0.36 differ by 10 % exactly


def _ordered(table: Table, study: Study, given: tuple[tuple[str, ...], ...]) -> Study:
    """The study with its sequences, which are balanced."""
    conditions = [one.name for one in study.condition]
    layouts = [one.name for one in study.layout]
    if given:
        found = tuple(
            tuple(_cell(table, f"[[sequence]] {number}: trials", text) for text in trials)
            for number, trials in enumerate(given, start=1)
        )
        for number, order in enumerate(found, start=1):
            for cell in order:
                for kind, name, names in (
                    ("condition", cell.condition, conditions),
                    ("layout", cell.layout, layouts),
                ):
                    if name not in names:
                        place = f"[[sequence]] {number}: trials"
                        raise table.error(place, f"{name!r} is no {kind}", suggest(name, names))
        wrong = imbalance(found)
        if wrong is not None:
            raise table.error("[[sequence]] 1: trials", f"unbalanced: {wrong.problem}", wrong.cure)
    else:
        try:
            found = orders(conditions, layouts, study.design)
        except ValueError as error:
            cure = f"write one layout, or at least {len(conditions)}"
            raise table.error("[[layout]] 1: name", f"unbalanced: {error}", cure) from None
    if study.participants % len(found):
        less = study.participants // len(found) * len(found)
        more = less + len(found)
        raise table.error(
            "participants",
            f"unbalanced: {study.participants} is no multiple of the {len(found)} sequences",
            f"write {less} or {more}" if less else f"write {more}",
        )
    return replace(study, orders=found)


def _cell(table: Table, place: str, text: str) -> Cell:
    condition, _, layout = text.partition(" ")
    if not layout or " " in layout:
        raise table.error(place, f"{text!r} is no trial", 'write "CONDITION LAYOUT" for each')
    return Cell(condition, layout)

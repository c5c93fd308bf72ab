"""Forms for the parameters of a node, made from their descriptors."""

from collections.abc import Awaitable, Callable, Coroutine, Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple, TypeAlias

from viser import ClientHandle, GuiApi, GuiCheckboxHandle, GuiDropdownHandle, GuiEvent, GuiHtmlHandle, GuiTextHandle

from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.parameters import Described, shown, written
from pidtsm_experiments.live.words import GREEN, RED

Widget: TypeAlias = GuiTextHandle | GuiCheckboxHandle | GuiDropdownHandle[str]
Apply: TypeAlias = Callable[[Mapping[str, Any]], Awaitable[None]]
"""Gives a node new values by name, or raises RefusedError."""
Agree: TypeAlias = Callable[[ClientHandle | None, Mapping[str, Any], Callable[[], Coroutine[Any, Any, None]]], bool]
"""Has a browser confirm that a node gets new values, and then calls back; false: nothing needs a confirmation."""
Run: TypeAlias = Callable[[Coroutine[Any, Any, None]], None]
"""Runs something in the thread of the page, and shows why it was refused, if it was."""


class Acts(NamedTuple):
    """What a form does with values."""

    apply: Apply
    agree: Agree
    run: Run


class Message:
    """A line below some controls: what became of the last attempt."""

    def __init__(self, gui: GuiApi) -> None:
        self._html: GuiHtmlHandle = gui.add_html("")

    def show(self, text: str, good: bool) -> None:
        """Replace the line."""
        style = f"color:{GREEN if good else RED};padding:0 0.75em 0.5em;font-size:0.85em;overflow-wrap:anywhere"
        self._html.content = f'<div role="status" style="{style}">{escape(text)}</div>'


class Form:
    """The parameters of one group; changed values take effect together, when the form is submitted."""

    def __init__(
        self, gui: GuiApi, title: str, parameters: Sequence[Described], acts: Acts, message: Message, expanded: bool
    ) -> None:
        """Add the form to the current container.

        Args:
            gui: of the page.
            title: shown above.
            parameters: what it contains.
            acts: what is done with changed values.
            message: where the result is shown.
            expanded: whether it is open at the start.
        """
        self._acts, self._message = acts, message
        self._known = {parameter.name: shown(parameter.value) for parameter in parameters}
        with gui.add_form(title, expand_by_default=expanded) as form:
            self._widgets = {parameter.name: _widget(gui, parameter) for parameter in parameters}
            submit = gui.add_button("Apply")

        @submit.on_click
        def _(event: GuiEvent[Any]) -> None:
            self._acts.run(self._submit(event.client))
            form.submit()  # Informs the browsers that nothing is left to apply; names no browser.

        @form.on_submit
        def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                self._acts.run(self._submit(event.client))

    def show(self, values: Mapping[str, Any]) -> None:
        """Show new values of the node."""
        for name, value in values.items():
            if name in self._widgets:
                self._known[name] = shown(value)
                self._reset(name)

    def _reset(self, name: str) -> None:
        widget = self._widgets[name]
        value = self._known[name] == str(True) if isinstance(widget, GuiCheckboxHandle) else self._known[name]
        if widget.value != value:
            setattr(widget, "value", value)  # noqa: B010  viser's types do not know that it can be set.

    async def _submit(self, client: ClientHandle | None) -> None:
        changed = {
            name: str(widget.value) for name, widget in self._widgets.items() if str(widget.value) != self._known[name]
        }
        if not changed:
            self._message.show("nothing has been changed", good=True)
            return
        try:
            values = {name: _value(self._widgets[name], text) for name, text in changed.items()}
        except RefusedError as error:
            self._message.show(str(error), good=False)
            raise
        if self._acts.agree(client, values, lambda: self._apply(changed, values)):
            self._message.show("not set yet: the change is large, and the arm is real", good=False)
        else:
            await self._apply(changed, values)

    async def _apply(self, changed: Mapping[str, str], values: Mapping[str, Any]) -> None:
        try:
            await self._acts.apply(values)
        except RefusedError as error:
            self._message.show(str(error), good=False)
            raise
        self._message.show(f"set {', '.join(f'{name} = {text}' for name, text in changed.items())}", good=True)


def _value(widget: Widget, text: str) -> Any:
    """The value of a widget: what is chosen, or what is written in a field."""
    if isinstance(widget, GuiCheckboxHandle):
        return bool(widget.value)
    return text if isinstance(widget, GuiDropdownHandle) else written(text)


def _widget(gui: GuiApi, parameter: Described) -> Widget:
    label, hint, value = parameter.label, parameter.hint, parameter.value
    if isinstance(value, bool):
        return gui.add_checkbox(label, value, hint=hint)
    if parameter.choices:
        return gui.add_dropdown(label, parameter.choices, initial_value=str(value), hint=hint)
    return gui.add_text(label, shown(value), hint=hint)


def groups(parameters: Iterable[Described]) -> dict[str, list[Described]]:
    """Parameters by their group, in the order in which the groups appear."""
    found: dict[str, list[Described]] = {}
    for parameter in parameters:
        found.setdefault(parameter.group, []).append(parameter)
    return found

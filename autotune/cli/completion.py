"""`autotune completion`: what a shell offers after Tab, made from the parser's own commands and options.

The scripts hold everything that does not change while this version is installed: commands, options, effects,
programmes, stages. Files are looked for by the shell: an axis file is a TOML file with `[limits]`, a model one with
`[inertia]`. Nothing of this program runs when Tab is pressed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import typer

from autotune.cli.output import answer
from autotune.core.errors import ConfigurationError

KINDS = {
    "AXIS.toml": "axis",
    "MODEL.toml": "model",
    "SERVICE.toml": "toml",
    "SURFACE.toml": "toml",
    "RECORDING...": "recording",
    "EFFECT... RECORDING...": "effect recording",
    "MODEL_OR_RECORDING...": "model recording",
    "MODEL.toml|RUN": "model folder",
    "AXIS.toml|RUN|FILE": "axis folder file",
    "FILE": "file",
    "FILE...": "file",
    "[FILE]...": "recording",
    "FILE.prom": "file",
    "FOLDER": "folder",
    "[RUN]": "folder",
    "NAME,...": "effect",
    "NAME[=SIZE]": "planted",
    "STAGE": "stage",
    "BASH|ZSH|FISH": "shell",
}
"""What may stand for a metavar; lower-case words with bars between them are the choice itself."""
_BY_NAME = {"runs": "folder", "out": "file", "programme": "programme", "link": "wire"}
_NOTHING = ""


@dataclass(frozen=True, slots=True)
class Offer:
    """What a command takes: options with the kind of their value (None: a flag), kind of its arguments."""

    options: dict[str, str | None]
    arguments: str
    help: str = ""


def completion(
    shell: Annotated[str, typer.Argument(metavar="BASH|ZSH|FISH", help="bash, zsh or fish.")],
) -> None:
    """Print what makes Tab complete commands, options, files and effects: for bash, zsh or fish."""
    if shell not in SCRIPTS:
        raise ConfigurationError(f"shell is {shell!r}; there is completion for {', '.join(SCRIPTS)}")
    answer(SCRIPTS[shell](offers()))


def offers() -> dict[str, Offer]:
    """What every command takes, by its words (`model fit`)."""
    from autotune.cli.main import COMMANDS, application

    found: dict[str, Offer] = {}
    for name in COMMANDS:
        command = typer.main.get_command(application([name]))
        found |= _offers(name, getattr(command, "commands", {name: command})[name])
    return found


def _offers(words: str, command: Any) -> dict[str, Offer]:
    below = getattr(command, "commands", None)
    line = str(command.help or "").partition("\n")[0]
    if below is None:
        return {words: _offer(command, line)}
    found = {words: Offer({"--help": None}, " ".join(below), line)}
    for name, one in below.items():
        found |= _offers(f"{words} {name}", one)
    return found


def _offer(command: Any, line: str) -> Offer:
    options: dict[str, str | None] = {"--help": None}
    arguments = []
    for parameter in command.params:
        if parameter.param_type_name == "argument":
            arguments.append(kind_of(parameter.name, parameter.metavar))
            continue
        for spelling in (*parameter.opts, *parameter.secondary_opts):
            options[spelling] = None if parameter.is_flag else kind_of(parameter.name, parameter.metavar)
    return Offer(options, " ".join(dict.fromkeys(" ".join(arguments).split())), line)


def kind_of(name: str, metavar: str | None) -> str:
    """What may stand for a parameter: kinds, or words to choose from after `=`; empty: nothing can be offered."""
    if metavar in KINDS:
        return KINDS[metavar]
    if metavar is None:
        return _BY_NAME.get(name, _NOTHING)
    choice = metavar.split("|")
    if (len(choice) > 1 and metavar.lower() == metavar) or name == "torque_unit":
        return f"={','.join(choice)}"
    return _NOTHING


def words_of(kind: str) -> str:
    """The words of a kind, with spaces between them; empty for kinds of files."""
    if kind.startswith("="):
        return kind[1:].replace(",", " ")
    if kind == "effect":
        from autotune.models.table import EFFECTS

        return " ".join(EFFECTS)
    if kind == "planted":
        from autotune_sim.effects import EFFECTS as PLANTED

        return " ".join(PLANTED)
    if kind == "programme":
        from autotune.experiments.programmes import PROGRAMMES

        return " ".join(PROGRAMMES)
    if kind == "stage":
        from autotune.tuning.request import STAGES

        return " ".join(STAGES)
    return {"wire": "canopen moteus", "shell": " ".join(SCRIPTS)}.get(kind, "")


FILES = ("axis", "model", "toml", "recording", "file", "folder")

_FILES = """\
_autotune_files() {
    # shell options
    local kind="$1" cur="$2" one
    for one in "$cur"*/; do [ -d "$one" ] && printf '%s\\n' "$one"; done
    [ "$kind" = folder ] && return
    for one in "$cur"*; do
        [ -f "$one" ] || continue
        case "$kind:$one" in
            axis:*.toml) grep -qs '^\\[limits\\]' "$one" || continue ;;
            model:*.toml) grep -qs '^\\[inertia\\]' "$one" || continue ;;
            toml:*.toml | recording:*.parquet | recording:*.csv | file:*) ;;
            *) continue ;;
        esac
        printf '%s\\n' "$one"
    done
}
"""


def bash(found: dict[str, Offer]) -> str:
    """For ~/.bashrc: source <(autotune completion bash)"""
    return "\n".join(
        [
            "# Completion of autotune for bash: source <(autotune completion bash)",
            _FILES,
            _KINDS_HEAD,
            *_kinds(found),
            "    esac\n}\n",
            _MAIN.replace("@TOP@", " ".join(_top(found))).replace("@GROUPS@", "|".join(_groups(found))),
            *_cases(found),
            _TAIL,
            "complete -o nospace -F _autotune autotune",
        ]
    )


def zsh(found: dict[str, Offer]) -> str:
    """For ~/.zshrc: source <(autotune completion zsh)"""
    head = "autoload -U +X compinit && compinit -u\nautoload -U +X bashcompinit && bashcompinit\n"
    first, _, rest = bash(found).partition("\n")
    return f"{first.replace('bash', 'zsh')}\n{head}{rest.replace(_ZSH_HERE, _ZSH_HERE + _ZSH_OPTIONS)}"


def fish(found: dict[str, Offer]) -> str:
    """For ~/.config/fish/completions/autotune.fish"""
    lines = [
        "# Completion of autotune for fish: autotune completion fish > ~/.config/fish/completions/autotune.fish",
        _FISH_FILES,
        "complete -c autotune -f",
    ]
    for words, offer in found.items():
        command, _, below = words.partition(" ")
        if not below:
            lines.append(
                f"complete -c autotune -n __fish_use_subcommand -a {command} -d {_quoted(offer.help)}"
            )
        seen = f"__fish_seen_subcommand_from {command}" + (
            f"; and __fish_seen_subcommand_from {below}" if below else ""
        )
        lines += _fish_offer(words, offer, _quoted(seen), found)
    return "\n".join(lines)


def _fish_offer(words: str, offer: Offer, when: str, found: dict[str, Offer]) -> list[str]:
    lines = []
    if words in _groups(found):
        below = " ".join(offer.arguments.split())
        first = _quoted(f"__fish_seen_subcommand_from {words}; and not __fish_seen_subcommand_from {below}")
        return [f"complete -c autotune -n {first} -a {_quoted(below)}"]
    for kind in offer.arguments.split():
        lines.append(f"complete -c autotune -n {when} -a {_fish_words(kind)}")
    for option, needed in offer.options.items():
        value = "" if needed is None else f" -x -a {_fish_words(needed)}" if needed else " -x"
        lines.append(f"complete -c autotune -n {when} -l {option.removeprefix('--')}{value}")
    return lines


def _fish_words(kind: str) -> str:
    parts = [f"(__autotune_files {one})" if one in FILES else words_of(one) for one in kind.split()]
    return _quoted(" ".join(parts))


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


def _top(found: dict[str, Offer]) -> list[str]:
    return [words for words in found if " " not in words]


def _groups(found: dict[str, Offer]) -> list[str]:
    return [words for words in found if any(other.startswith(f"{words} ") for other in found)]


def _kinds(found: dict[str, Offer]) -> list[str]:
    """One case for each kind that is used."""
    every = {offer.arguments for words, offer in found.items() if words not in _groups(found)}
    every |= {kind for offer in found.values() for kind in offer.options.values() if kind}
    lines = []
    for kind in sorted({one for some in every for one in some.split()}):
        body = (
            f'_autotune_files {kind} "$cur"'
            if kind in FILES
            else f'compgen -W "{words_of(kind)}" -- "$cur" | sed "s/$/ /"'
        )
        lines.append(f'        "{kind}") {body} ;;')
    return lines


def _cases(found: dict[str, Offer]) -> list[str]:
    """For each command: the kind of the value that an option waits for, its options, its arguments."""
    lines = []
    for words, offer in found.items():
        if words in _groups(found):
            lines.append(f'        "{words}") choices="{offer.arguments}" ;;')
            continue
        lines.append(f'        "{words}")')
        lines.append(f'            options="{" ".join(offer.options)}"; kinds="{offer.arguments}"')
        waiting = {name: kind for name, kind in offer.options.items() if kind is not None}
        if waiting:
            lines.append('            case "$prev" in')
            lines += [f'                {name}) waits=1; kinds="{kind}" ;;' for name, kind in waiting.items()]
            lines.append("            esac")
        lines.append("            ;;")
    return lines


_ZSH_HERE = "    # shell options\n"
_ZSH_OPTIONS = "    setopt local_options ksh_arrays sh_word_split null_glob\n"
_KINDS_HEAD = """\
_autotune_kind() {
    local cur="$2"
    case "$1" in"""
_MAIN = """\
_autotune() {
    # shell options
    local IFS=$' \\t\\n' cur prev command options="" kinds="" choices="" waits="" kind one
    cur="${COMP_WORDS[COMP_CWORD]}"; prev="${COMP_WORDS[COMP_CWORD-1]}"; command="${COMP_WORDS[1]}"
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        choices="@TOP@ --help --version"; command=""
    fi
    case "$command" in
        @GROUPS@) [ "$COMP_CWORD" -gt 2 ] && command="$command ${COMP_WORDS[2]}" ;;
    esac
    case "$command" in"""
_TAIL = """\
    esac
    if [ -n "$choices" ]; then
        while IFS= read -r one; do COMPREPLY+=("$one "); done < <(compgen -W "$choices" -- "$cur")
        return
    fi
    if [ -z "$waits" ]; then
        case "$cur" in
            -*) while IFS= read -r one; do COMPREPLY+=("$one "); done < <(compgen -W "$options" -- "$cur"); return ;;
        esac
    fi
    for kind in $kinds; do
        while IFS= read -r one; do
            [ -f "$one" ] && one="$one "
            COMPREPLY+=("$one")
        done < <(_autotune_kind "$kind" "$cur")
    done
}
"""
_FISH_FILES = """\
function __autotune_files
    set -l cur (commandline -ct)
    for one in $cur*/
        echo $one
    end
    for one in $cur*
        test -f $one; or continue
        switch $argv[1]
            case axis
                string match -q '*.toml' $one; and grep -qs '^\\[limits\\]' $one; and echo $one
            case model
                string match -q '*.toml' $one; and grep -qs '^\\[inertia\\]' $one; and echo $one
            case toml
                string match -q '*.toml' $one; and echo $one
            case recording
                string match -qr '\\.(parquet|csv)$' $one; and echo $one
            case file
                echo $one
        end
    end
end
"""

SCRIPTS = {"bash": bash, "zsh": zsh, "fish": fish}

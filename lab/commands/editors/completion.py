"""Print the completion script for SHELL."""

import click
from click.shell_completion import get_completion_class

from formnet.lab.commands.options import Command


@click.command("completion", cls=Command)
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
@click.pass_context
def command(context: click.Context, shell: str) -> None:
    """Print the completion script for SHELL.

    \b
    bash: echo 'eval "$(formnet completion bash)"' >> ~/.bashrc
    zsh:  echo 'eval "$(formnet completion zsh)"' >> ~/.zshrc
    fish: formnet completion fish > ~/.config/fish/completions/formnet.fish
    """
    kind = get_completion_class(shell)
    assert kind is not None
    group = context.find_root().command
    click.echo(kind(group, {}, "formnet", "_FORMNET_COMPLETE").source())

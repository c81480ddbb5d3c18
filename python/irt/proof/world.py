"""The concealed world: a subprocess that hides physics in rigs and records them, one line of JSON each way.

For a request

``{"make": {"index": 3, "kind": "none|outliers|single|pair|triple|unlisted", "folder": "...", "seed": 7}}``

it writes the rig's recordings and ``rig.toml`` into the folder, and answers ``{"label": {...}}``: ``kind``
(an effect, a list of effects, ``none``, ``outliers`` or ``unlisted_...``), ``truth`` (parameters by name,
``effects``), ``sigma`` of the tracker [board edges], ``noise``, ``drive``, ``through_camera``, and ``tests``
by name, each with its ``csv`` and the ``clean`` path [board edges]. ``lost`` names the runs that its tracker
could not read, with the reasons; their cells are empty, and ``sigma`` is null if there is no other run. Such
a rig is sealed like any other. Its diagnosis fails, which counts.

A world may also record further runs of its rigs. For a request
``{"record": {"index": 3, "kind": "...", "seed": 7, "csv": "..."}}`` with commands and a start in row 0 it
answers ``{"csv": "..."}``, the tracked run. A failure is answered with ``{"error": "..."}``.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from irt.errors import IrtError


class World:
    """A running world, which Ctrl-C does not reach; lines of its output that are no JSON objects are ignored.

    Raises
    ------
    IrtError
        If it cannot be started.
    """

    def __init__(self, command: Sequence[str], what: str = "the program that makes the rigs") -> None:
        self._what = what
        try:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                start_new_session=True,
            )
        except OSError as error:
            raise IrtError(f"{what} cannot be started ({command[0]}): {error.strerror}") from error

    def ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Send a request and return the answer.

        Raises
        ------
        IrtError
            If the process has ended or answers with an error.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(f"{json.dumps(request)}\n")
            self._process.stdin.flush()
        except OSError as error:
            raise self._ended() from error
        for line in self._process.stdout:
            if line.lstrip().startswith("{"):
                answer: dict[str, Any] = json.loads(line)
                if "error" in answer:
                    raise IrtError(f"{answer['error']}")
                return answer
        raise self._ended()

    def stop(self) -> None:
        """Kill the process and its subprocesses."""
        if self._process.poll() is not None:
            return
        # It may end, and another thread may wait for it, between the question and the signal.
        with suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
            else:
                self._process.kill()

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the process' input and wait for its end."""
        try:
            self._process.communicate(timeout=5.0)
        except (subprocess.TimeoutExpired, OSError, ValueError):
            self.stop()
            self._process.wait()

    def _ended(self) -> IrtError:
        status = self._process.wait()
        return IrtError(f"{self._what} ended before it answered (exit status {status}); its error is above")

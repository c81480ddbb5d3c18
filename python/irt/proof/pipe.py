"""A subprocess that answers requests over standard input and output, one line of JSON each."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TextIO

from irt.errors import IrtError


class Pipe:
    """A subprocess that answers requests.

    Lines of its output that are no JSON objects are ignored, because libraries print greetings.

    Parameters
    ----------
    command : sequence of str
        The command line.
    what : str
        Its name in messages.
    apart : bool
        Whether Ctrl-C does not reach it. The program in the foreground then has to end it together with its
        own subprocesses.

    Raises
    ------
    IrtError
        If it cannot be started.
    """

    def __init__(self, command: Sequence[str], what: str, *, apart: bool = True) -> None:
        self._what, self._apart = what, apart
        try:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                start_new_session=apart,
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
        try:
            self._process.stdin.write(f"{json.dumps(request)}\n")
            self._process.stdin.flush()
        except OSError as error:
            raise self._ended() from error
        answer = self._answer()
        if "error" in answer:
            raise IrtError(f"{answer['error']}")
        return answer

    def stop(self) -> None:
        """Kill the process and its subprocesses."""
        if self._process.poll() is None:
            if self._apart and hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
            else:
                self._process.kill()

    def close(self) -> None:
        """Close the process' input and wait for its end."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                try:
                    stream.close()
                except OSError:
                    continue
        try:
            self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Pipe:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.lstrip().startswith("{"):
                answer: dict[str, Any] = json.loads(line)
                return answer
        raise self._ended()

    def _ended(self) -> IrtError:
        status = self._process.wait()
        return IrtError(f"{self._what} ended before it answered (exit status {status}); its error is above")


def serve(
    answer: Callable[[dict[str, Any]], Mapping[str, Any]],
    requests: TextIO | None = None,
    answers: TextIO | None = None,
) -> None:
    """Answer requests until the input ends; failures are answered with ``{"error": ...}``.

    Parameters
    ----------
    answer : callable
        Returns the answer to a request; may raise `IrtError`.
    requests, answers : text streams, optional
        By default standard input and output.
    """
    answers = answers or sys.stdout
    for line in requests or sys.stdin:
        try:
            result = dict(answer(json.loads(line)))
        except IrtError as error:
            result = {"error": str(error)}
        print(json.dumps(result), file=answers, flush=True)

"""Make a virtual environment with Quietfix in it, or leave it alone where it is already as it should be.

    python3 .ci/environment.py FOLDER [--extras test,bench] [--python EXECUTABLE]
    python3 .ci/environment.py --find-newer

The Makefile calls this with the system's ``python3``; only the standard library is used. ``FOLDER/.ready``
is written last and says what was installed: an environment without it is unfinished (Ctrl-C, a lost
connection) and is made again from nothing. ``--find-newer`` prints the path of a Python 3.13 or 3.12 that
really runs, or nothing: a shim of that name on the PATH proves nothing.
"""

import argparse
import glob
import hashlib
import json
import os
import shutil
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
OLDEST = (3, 11)
NEWER = ("3.13", "3.12")  # what constraints.txt pins for Drake 1.58
INHERITED = ("PYTHONPATH", "PYTHONHOME", "PIP_USER", "PIP_TARGET", "PIP_PREFIX", "PIP_CONSTRAINT")
PROBE = (
    "import sys, sysconfig, venv, ensurepip, ssl, zlib;"
    "free = sysconfig.get_config_var('Py_GIL_DISABLED') and 't' or '';"
    "print('%d.%d%s' % (sys.version_info[:2] + (free,)), sys.version.split()[0],"
    " getattr(sys, '_base_executable', sys.executable), sep='\\n')"
)


def fail(message):
    """Say what is wrong in one line and leave."""
    print("environment: " + message, file=sys.stderr)
    sys.exit(2)


def clean_environ():
    """Return the environment variables without those that would lead pip or Python elsewhere."""
    return {name: value for name, value in os.environ.items() if name not in INHERITED}


def probe(python):
    """Return (minor version, full version, base executable) of an interpreter, or None if it does not run."""
    try:
        answer = subprocess.run(
            [python, "-c", PROBE],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=clean_environ(),
            timeout=30,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    lines = answer.stdout.decode().splitlines()
    return tuple(lines) if len(lines) == 3 else None


def find_newer():
    """Return the base executable of a Python of ``NEWER`` that runs and can make environments, or None."""
    if sys.version_info[:2] >= (3, 12):
        return None  # the first environment is the new one already
    pyenv = os.environ.get("PYENV_ROOT") or os.path.expanduser("~/.pyenv")
    for version in NEWER:
        on_path = shutil.which("python" + version)
        pattern = os.path.join(glob.escape(pyenv), "versions", version + "*", "bin", "python")
        for candidate in [on_path, *sorted(glob.glob(pattern))]:
            found = candidate and probe(candidate)
            if found and found[0] == version:
                return found[2]
    return None


def run(*command):
    """Run a command without standard input; on failure leave with its status."""
    done = subprocess.run(command, stdin=subprocess.DEVNULL, env=clean_environ(), cwd=ROOT, check=False)
    if done.returncode:
        fail("'{}' failed with status {}".format(" ".join(command), done.returncode))


def key_of(interpreter):
    """Return a digest of everything that decides what the environment must hold, its extras aside."""
    digest = hashlib.sha256("\n".join([ROOT, *interpreter]).encode())
    for name in ("pyproject.toml", "constraints.txt"):
        with open(os.path.join(ROOT, name), "rb") as file:
            digest.update(file.read())
    return digest.hexdigest()


def read_ready(path):
    """Return what ``.ready`` says, or None where it is absent or unreadable."""
    try:
        with open(path) as file:
            return json.load(file)
    except (OSError, ValueError):
        return None


def make(folder, extras, python):
    """Bring the environment in `folder` to the state that pyproject.toml and constraints.txt ask for."""
    interpreter = probe(python)
    if interpreter is None:
        fail(f"{python} cannot make virtual environments (on Debian: apt install python3-venv)")
    if tuple(int(part) for part in interpreter[0].rstrip("t").split(".")) < OLDEST:
        fail("Python {}.{} or newer is needed, {} is {}".format(*OLDEST, python, interpreter[1]))

    ready_path = os.path.join(folder, ".ready")
    own_python = os.path.join(folder, "bin", "python")
    key = key_of(interpreter)
    ready = read_ready(ready_path) if os.path.exists(own_python) else None
    if ready and ready["key"] == key and set(extras) <= set(ready["extras"]):
        return

    usable = ready and ready["root"] == ROOT and ready["interpreter"] == list(interpreter)
    wanted = sorted(set(extras) | set(ready["extras"] if usable else []))
    what = "{}: Python {}, quietfix{}".format(
        os.path.relpath(folder), interpreter[1], "[{}]".format(",".join(wanted)) if wanted else ""
    )
    print(f"{what}: installing (a minute or two the first time)", flush=True)
    if ready:
        os.remove(ready_path)
    if not usable:
        run(interpreter[2], "-m", "venv", "--clear", folder)
    pip = [own_python, "-m", "pip", "install", "-qq", "--no-input", "--progress-bar", "off"]
    pip += ["--disable-pip-version-check", "-c", "constraints.txt"]
    # setuptools first, and no build isolation: the build tool is pinned too.
    run(*pip, "setuptools")
    run(*pip, "--no-build-isolation", "-e", ".[{}]".format(",".join(wanted)) if wanted else ".")
    run(own_python, "-m", "pip", "-qq", "check")

    partial = ready_path + ".partial"
    with open(partial, "w") as file:
        json.dump({"key": key, "root": ROOT, "interpreter": interpreter, "extras": wanted}, file, indent=2)
    os.replace(partial, ready_path)


def main():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", help="where the environment is or will be")
    parser.add_argument("--extras", default="", help="extras of pyproject.toml, separated by commas")
    parser.add_argument("--python", default=sys.executable, help="the interpreter (default: this one)")
    parser.add_argument("--find-newer", action="store_true", help="print a Python 3.13 or 3.12 that runs")
    options = parser.parse_args()
    if options.find_newer:
        print(find_newer() or "")
    elif options.folder:
        extras = [extra for extra in options.extras.split(",") if extra]
        make(os.path.abspath(options.folder), extras, options.python)
    else:
        parser.error("FOLDER or --find-newer is needed")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        print("\nenvironment: interrupted; the next make starts this environment again", file=sys.stderr)
        sys.exit(130)

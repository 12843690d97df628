"""Types of msg/ and srv/ keep the MD5 sums of interfaces.md5: bags and clients of a release depend on them.

Run as a program, in an environment with the built package, it prints the list:

  . build/colcon/install/setup.bash
  python3 test/python/test_interfaces.py >test/python/interfaces.md5
"""
import pathlib

from constraint_sim import msg, srv

HERE = pathlib.Path(__file__).resolve()
SOURCES, LIST = HERE.parents[2], HERE.with_name('interfaces.md5')
WHAT_TO_DO = '''
Programs and bags that use another sum cannot talk to this one. Leave a released type as it is, and add a type,
or a field to a type that is not released. A change that is meant needs a new minor release and an entry `Old -> new`
in CHANGELOG.rst; then print the list anew: python3 test/python/test_interfaces.py >test/python/interfaces.md5'''


def built_sums():
    """Returns the sums that the built package has on the wire, by `msg/Body` or `srv/AddBody`."""
    return {f'{kind}/{path.stem}': getattr(module, path.stem)._md5sum
            for kind, module in (('msg', msg), ('srv', srv)) for path in SOURCES.glob(f'{kind}/*.{kind}')}


def released_sums():
    lines = (line.split() for line in LIST.read_text().splitlines())
    return {name: md5 for md5, name in lines}


def differences(built, released):
    """Returns a line for each type that is new, missing or different."""
    lines = []
    for name in sorted(built.keys() | released.keys()):
        if name not in built:
            lines.append(f'{name}: is in {LIST.name}, and not in the package')
        elif name not in released:
            lines.append(f'{name}: is not in {LIST.name}; its line: {built[name]}  {name}')
        elif built[name] != released[name]:
            lines.append(f'{name}: has the sum {built[name]}, {LIST.name} has {released[name]}')
    return lines


def test_types_have_their_released_sums():
    different = differences(built_sums(), released_sums())
    assert not different, '\n'.join(different) + WHAT_TO_DO


def test_each_difference_is_named():
    built = {'msg/Body': '1', 'msg/New': '2', 'srv/Same': '3'}
    released = {'msg/Body': '4', 'srv/Same': '3', 'srv/Gone': '5'}
    assert [line.split(':')[0] for line in differences(built, released)] == ['msg/Body', 'msg/New', 'srv/Gone']


if __name__ == '__main__':
    for type_name, sum_of_type in sorted(built_sums().items()):
        print(sum_of_type, type_name, sep='  ')

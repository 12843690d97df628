"""Results as a table: Parquet where pyarrow is there, else CSV."""
import csv
import math

from .study import CHOICES

try:
    import pyarrow
    import pyarrow.parquet
except ImportError:
    pyarrow = None


def rows(study, entries, results):
    """A dict each case, in the order of the grid. A case without a result is not there."""
    found = []
    for case, key in entries:
        result = results.get(key)
        if result is None:
            continue
        row = {'case': case.index, 'scene': case.scene, **case.values, 'method': case.method.name,
               'time_step': case.time_step, 'tolerance': case.tolerance}
        for name in CHOICES:  # choices that do not vary stand in the method's options, or nowhere
            if row[name] is None:
                row[name] = case.method.options.get(name)
        found.append({**row, **{name: result[name] for name in result}})
    return found


def columns(table):
    """All names, in the order in which rows have them."""
    return list(dict.fromkeys(name for row in table for name in row))


def text(value):
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ''
    if isinstance(value, (list, tuple)):
        return ' '.join(text(element) for element in value)
    return repr(value) if isinstance(value, float) else str(value)


def write(folder, name, table):
    """Path of the file that was written."""
    names = columns(table)
    if pyarrow is not None:
        path = folder / f'{name}.parquet'
        data = {}
        for column in names:
            values = [row.get(column) for row in table]
            if any(isinstance(value, (str, tuple, list)) for value in values):
                values = [text(value) for value in values]
            data[column] = values
        pyarrow.parquet.write_table(pyarrow.table(data), path)
        return path
    path = folder / f'{name}.csv'
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(names)
        writer.writerows([text(row.get(column)) for column in names] for row in table)
    return path


def sample_rows(entries, store):
    from .child import COMPONENTS
    for case, key, bodies in entries:
        if not (store.folder / 'samples' / f'{key}.npz').exists():
            continue
        times, states = store.samples(key)
        for time, state in zip(times, states):
            for body, numbers in zip(bodies, state):
                yield {'case': case.index, 'time': float(time), 'body': body,
                       **dict(zip(COMPONENTS, map(float, numbers)))}

"""Evaluation of the node's `statistics` messages, for watch_error and bag_report."""
import collections
import csv
import math

COLUMNS = {
    'sim_time': 'simulated time [s]',
    'run_time': 'wall time of the ticks over simulated time [µs/s]',
    'constraint_error': 'largest error of the constraints [m]',
    'energy_drift': 'change of energy over the largest kinetic energy [1]',
    'local_error': 'largest estimate for one tick [m], empty where there is none',
    'accumulated_error': 'sum of these estimates since the start [m], empty where one is missing',
    'tick': 'simulated time of a tick [s]',
    'methods': 'in use',
}
Line = collections.namedtuple('Line', COLUMNS)
# Colours and labels of quantities drawn against run time and time.
ERRORS = {'constraint_error': 'constraints [m]', 'energy_drift': 'energy drift [1]',
          'accumulated_error': 'local errors, summed [m]'}
SMALLEST = 1e-17  # errors of zero are drawn here
ESTIMATES = ('local_error', 'accumulated_error')  # NaN where a tick had none
NO_ESTIMATE = 'unknown: a tick has no estimate'


class Reader:
    """Makes a line from each two successive messages; none from the first, and none where no tick was
    taken."""

    def __init__(self):
        self.before = None

    def line(self, message):
        before, self.before = self.before, message
        if before is None or message.step <= before.step:
            return None
        span = (message.sim_time - before.sim_time).to_sec()
        if span <= 0.0:
            return None
        tick = span / (message.step - before.step)
        return Line(message.sim_time.to_sec(), 1e6 * message.wall_mean / tick,
                    message.max_constraint_error, abs(message.energy_drift), message.local_error,
                    message.accumulated_local_error, tick, ' '.join(message.methods))


def write_csv(lines, path):
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        writer.writerows([shown if known(shown) else '' for shown in line] for line in lines)


def draw(axes, lines):
    """Draws error against run time on the first axis, error and run time against time on the others."""
    from matplotlib import ticker  # needed for drawing only
    against_cost, against_time, cost = axes
    times = [line.sim_time for line in lines]
    run_times = [line.run_time for line in lines]
    for axis in axes:
        axis.clear()
    for name, label in ERRORS.items():
        # the plot skips NaN, which means that there is no estimate
        values = [value if math.isnan(value) else max(value, SMALLEST)
                  for value in (getattr(line, name) for line in lines)]
        against_cost.plot(run_times, values, '.', label=label)
        against_time.plot(times, values, label=label)
    cost.plot(times, run_times)
    against_cost.set(xscale='log', yscale='log', ylabel='error',
                     xlabel='run time per simulated second [µs]')
    against_time.set(yscale='log', xlabel='simulated time [s]', ylabel='error')
    cost.set(yscale='log', xlabel='simulated time [s]', ylabel='run time per simulated second [µs]')
    # run times span few powers of ten: labels between these, without overlap
    for axis in (against_cost.xaxis, cost.yaxis):
        axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(ticker.FormatStrFormatter('%g'))
        axis.set_minor_formatter(ticker.NullFormatter())
    against_cost.legend()


def summary(lines):
    """Returns the largest of each error and the range of run time, as text."""
    run_times = sorted(line.run_time for line in lines)
    methods = sorted(set(' '.join(line.methods for line in lines).split()))
    return '\n'.join([
        f'{lines[-1].sim_time - lines[0].sim_time:.3g} s of simulated time, {len(lines)} messages, '
        f'methods: {" ".join(methods) or "none"}',
        f'run time          {run_times[len(run_times) // 2]:.4g} µs per simulated second (median), '
        f'{run_times[-1]:.4g} at most',
        *(f'{name:<17} {worst(lines, name)}'
          for name in ('constraint_error', 'energy_drift', 'local_error')),
        'accumulated_error ' + (f'{lines[-1].accumulated_error:.3g} at the end'
                                if known(lines[-1].accumulated_error) else NO_ESTIMATE)])


def worst(lines, name):
    values = [getattr(line, name) for line in lines]
    if not all(known(value) for value in values):
        return NO_ESTIMATE
    return f'{max(values):.3g} at most'


def known(value):
    """Returns whether a number or text is known: estimates of impulses are NaN."""
    return not (isinstance(value, float) and math.isnan(value))


def is_finite(line):
    """Returns whether all known numbers can be drawn."""
    return all(math.isfinite(value) for name, value in line._asdict().items()
               if isinstance(value, float) and not (name in ESTIMATES and math.isnan(value)))

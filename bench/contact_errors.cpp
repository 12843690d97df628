// Compares the error estimate of steps of contacts with their true error, in random scenes
// (contact_errors.h).
//
//   PROGRAM [--scenes 100] [--seed 0] [--tolerance 1e-4] [--parts 8] [--method time_stepping]
//
// With a tolerance of 0 a step is one part, with the estimate from its velocities.
// Prints quantiles of the ratio of estimate to error over the steps in contact whose error exceeds
// 1e-8 m (column "off"), and the share of them whose estimate is below a quarter of the error.
// Other columns: parts kept and rejected in a step, steps without an estimate, since their impulses
// were not solved, steps that were not compared, and references by events.

#include "contact_errors.h"

#include <boost/program_options.hpp>
#include <cstdio>
#include <string>

namespace {

namespace po = boost::program_options;
using namespace constraint_sim::engine;
using namespace constraint_sim::engine::contact_errors;

void print(const char* name, Table table) {
  std::vector<Ratio>& ratios = table.ratios;
  std::sort(ratios.begin(), ratios.end(),
            [](const Ratio& a, const Ratio& b) { return a.ratio < b.ratio; });
  const auto steps = static_cast<double>(std::max(table.steps, 1L));
  std::printf("%-16s %6ld %6.1f %6.1f %5ld %5ld %6ld %6zu", name, table.steps,
              static_cast<double>(table.kept) / steps, static_cast<double>(table.rejected) / steps,
              table.unsolved, table.left_out, table.by_events, ratios.size());
  if (!ratios.empty()) {
    const auto quantile = [&](double share) {
      return ratios[static_cast<std::size_t>(share * static_cast<double>(ratios.size() - 1))].ratio;
    };
    const auto low = std::count_if(ratios.begin(), ratios.end(),
                                   [](const Ratio& one) { return one.ratio < kTooLow; });
    std::printf(" %9.2g %9.2g %9.2g %9.2g %9.2g %7.2f %%", quantile(0.0), quantile(0.01),
                quantile(0.1), quantile(0.5), quantile(0.9),
                100.0 * static_cast<double>(low) / static_cast<double>(ratios.size()));
  }
  std::printf("\n");
  for (std::size_t i = 0; i < std::min<std::size_t>(ratios.size(), 6); ++i)
    if (ratios[i].ratio < kTooLow)
      std::printf("    kind %u seed %u at %.4f s: %.2g of %.2g m\n", ratios[i].kind, ratios[i].seed,
                  ratios[i].time, ratios[i].ratio, ratios[i].error);
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  std::string method;
  po::options_description options("Options");
  options.add_options()("scenes", po::value(&settings.scenes)->default_value(100))(
      "seed", po::value(&settings.seed)->default_value(0))(
      "tolerance", po::value(&settings.tolerance)->default_value(1e-4))(
      "parts", po::value(&settings.parts)->default_value(8))(
      "method", po::value(&method)->default_value(name(settings.method)));
  try {
    po::variables_map given;
    po::store(po::parse_command_line(argc, argv, options), given);
    po::notify(given);
    if (method == name(Method::kSequentialImpulses))
      settings.method = Method::kSequentialImpulses;
    else if (method != name(Method::kTimeStepping))
      throw po::error("method: " + method + " is neither time_stepping nor sequential_impulses");
  } catch (const po::error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  std::printf("%-16s %6s %6s %6s %5s %5s %6s %6s %9s %9s %9s %9s %9s %9s\n", "scenes", "steps",
              "kept", "reject", "none", "left", "events", "off", "least", "1 %", "10 %", "median",
              "90 %", "below 1/4");
  Table all;
  for (const random_events::Kind kind :
       {random_events::Kind::kTouching, random_events::Kind::kTouchingWithLaws,
        random_events::Kind::kTouchingWithPoses}) {
    Table table;
    for (unsigned i = 0; i < settings.scenes; ++i)
      compare(settings, static_cast<unsigned>(kind), settings.seed + i, &table);
    all.steps += table.steps;
    all.unsolved += table.unsolved;
    all.kept += table.kept;
    all.rejected += table.rejected;
    all.left_out += table.left_out;
    all.by_events += table.by_events;
    all.ratios.insert(all.ratios.end(), table.ratios.begin(), table.ratios.end());
    print(random_events::kKindNames[static_cast<std::size_t>(kind)], table);
  }
  print("all", all);
}

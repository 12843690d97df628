// Judges random event-driven scenes (random_events.h), of all kinds in turn. Prints each finding
// with the kind and seed of its scene, and a table.
//
//   PROGRAM [--scenes 2000] [--seed 0] [--kind 0...12] [--threads 2]
//
// --seed: of the first scene of each kind; --kind: judges this kind only. Exit status 1 for
// findings, 2 for wrong arguments. Scenes that the engine gives up are counted, and no failure: it
// reports them. The last columns are the dearest tick of a scene over its median tick, in
// evaluations of the equations of motion: the largest of all scenes, and in how many it exceeds
// 200.

#include <atomic>
#include <boost/program_options.hpp>
#include <cstdlib>
#include <mutex>
#include <thread>

#include "judge_events.h"

namespace {

namespace po = boost::program_options;
namespace events = constraint_sim::engine::random_events;

struct Options {
  unsigned scenes = 0, seed = 0, threads = 0;
  int kind = -1;
};

struct Count {
  unsigned scenes = 0, followed = 0, events = 0, given_up = 0, left = 0, off = 0;
  double worst_tick = 0.0;
  unsigned dear = 0;
};

constexpr double kMostOverMedian = 200.0;
constexpr int kKinds = static_cast<int>(events::kKindNames.size());

int run(const Options& options) {
  std::vector<Count> counts(events::kKindNames.size());
  std::atomic<unsigned> next{0};
  std::mutex output;
  const auto work = [&] {
    for (unsigned i = next++; i < options.scenes; i = next++) {
      const auto kind = static_cast<unsigned>(options.kind);
      const std::size_t k = options.kind < 0 ? i % kKinds : kind;
      const unsigned seed = options.seed + (options.kind < 0 ? i / kKinds : i);
      const events::Verdict verdict = events::judge(static_cast<events::Kind>(k), seed);
      const std::lock_guard<std::mutex> lock(output);
      Count& count = counts[k];
      count.scenes += 1;
      count.followed += verdict.was_followed;
      count.events += verdict.events;
      count.given_up += verdict.is_given_up;
      count.left += verdict.is_left;
      count.off += !verdict.findings.empty();
      count.worst_tick = std::max(count.worst_tick, verdict.worst_tick);
      count.dear += verdict.worst_tick > kMostOverMedian;
      for (const std::string& finding : verdict.findings)
        std::printf("--kind %d --seed %u (%s): %s\n", static_cast<int>(k), seed,
                    events::kKindNames[k], finding.c_str());
      std::fflush(stdout);
    }
  };
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < options.threads; ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();

  std::printf("%-20s %8s %10s %8s %9s %16s %5s %12s %5s\n", "", "scenes", "followed", "events",
              "given up", "left to impulses", "off", "worst/median", ">200");
  unsigned off = 0;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    const Count& count = counts[k];
    std::printf("%-20s %8u %10u %8u %9u %16u %5u %12.0f %5u\n", events::kKindNames[k], count.scenes,
                count.followed, count.events, count.given_up, count.left, count.off,
                count.worst_tick, count.dear);
    off += count.off;
  }
  return off == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  po::options_description described;
  described.add_options()("scenes", po::value(&options.scenes)->default_value(2000))(
      "seed", po::value(&options.seed)->default_value(0), "of the first of each kind")(
      "kind", po::value(&options.kind)->default_value(-1), "0 to 12, none other")(
      "threads", po::value(&options.threads)->default_value(2));
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, described), values);
    po::notify(values);
    if (options.kind >= kKinds || options.threads < 1 || options.threads > 64)
      throw po::error("out of range");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return run(options);
}

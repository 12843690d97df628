// Prints the cost of an event in substeps: substeps taken or tried in ticks with events, beyond
// those of ticks without, over the number of events. For shipped event-driven scenes, and for the
// random ones of random_events.h. Counts are the same in every run.
//
//   PROGRAM [FOLDER]      folder of the scenes, config/scenes if not given

#include "event_costs.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "constraint_sim/engine/scene.h"

namespace {

using namespace constraint_sim::engine;
using namespace constraint_sim::engine::event_costs;
namespace events = constraint_sim::engine::random_events;

constexpr unsigned kSeeds = 200;
constexpr double kRandomDuration = 2.0;  // [s]

void print_scenes(const std::string& folder) {
  std::printf(
      "| scene | ticks | events | substeps of a tick without | substeps of an event |\n"
      "| --- | ---: | ---: | ---: | ---: |\n");
  for (const char* name : kScenes) {
    const Costs costs = follow(load_scene_file(folder + "/" + name + ".yaml"), kDuration);
    std::printf("| %s | %u | %u | %.2f | %.1f |\n", name, costs.ticks, costs.events,
                costs.ordinary(), costs.of_an_event());
  }
}

void print_random() {
  std::printf(
      "\n| random scenes | events | median | 95 %% | 99 %% | most |\n"
      "| --- | ---: | ---: | ---: | ---: | ---: |\n");
  for (std::size_t k = 0; k < events::kKindNames.size(); ++k) {
    std::vector<double> of_events;  // mean substeps of each event in its tick
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
      const events::Scene scene = events::scene_of(static_cast<events::Kind>(k), seed);
      const Costs costs = follow(events::world_of(scene), kRandomDuration);
      for (const auto& [cost, count] : costs.of_ticks)
        of_events.insert(of_events.end(), count, (cost - costs.ordinary()) / count);
    }
    std::sort(of_events.begin(), of_events.end());
    const auto at = [&](double share) {
      return of_events[static_cast<std::size_t>(share * static_cast<double>(of_events.size() - 1))];
    };
    std::printf("| %s | %zu | %.1f | %.1f | %.1f | %.0f |\n", events::kKindNames[k],
                of_events.size(), at(0.5), at(0.95), at(0.99), at(1.0));
  }
}

}  // namespace

int main(int argc, char** argv) {
  print_scenes(argc > 1 ? argv[1] : "config/scenes");
  print_random();
}

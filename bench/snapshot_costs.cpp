// Prints bytes and time of a copy of a world, and of a snapshot for publishing: 1000 bodies on 1000
// rods, as one chain and as pendula.
//
// Usage: constraint_sim_snapshot_costs

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace {

std::size_t allocated = 0;  // [bytes]

}  // namespace

void* operator new(std::size_t size) {
  allocated += size;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace {

using namespace constraint_sim::engine;

constexpr int kBodies = 1000;
constexpr int kSteps = 20;
constexpr int kTimes = 201;

World bodies_on_rods(bool is_chain) {
  World world;
  BodyId before = kWorldBody;
  for (int i = 0; i < kBodies; ++i) {
    Body bob;
    bob.name = "bob_" + std::to_string(i);
    bob.mass = 1.0;
    bob.state.position = {i + 1.0, 0.0, 0.0};
    Joint rod;
    rod.name = "rod_" + std::to_string(i);
    rod.body_a = is_chain ? before : kWorldBody;
    if (!is_chain) rod.anchor_a = {static_cast<double>(i), 0.0, 0.0};
    rod.body_b = before = world.add_body(bob);
    world.add_joint(rod);
  }
  return world;
}

struct Cost {
  double kilobytes;     // size of a first copy
  double microseconds;  // time of a copy into the previous one, median
};

template <class Copy>
Cost cost_of(const World& world, Copy copy) {
  World other;
  const std::size_t before = allocated;
  copy(world, &other);
  const std::size_t bytes = allocated - before;
  std::vector<double> times;
  for (int i = 0; i < kTimes; ++i) {
    const auto start = std::chrono::steady_clock::now();
    copy(world, &other);
    const std::chrono::duration<double, std::micro> passed =
        std::chrono::steady_clock::now() - start;
    times.push_back(passed.count());
  }
  std::nth_element(times.begin(), times.begin() + kTimes / 2, times.end());
  return {static_cast<double>(bytes) / 1e3, times[kTimes / 2]};
}

void print(const char* scene, const char* what, const Cost& cost) {
  std::printf("| %s | %s | %.0f | %.0f |\n", scene, what, cost.kilobytes, cost.microseconds);
}

}  // namespace

int main() {
  std::printf("| scene | what | kB | µs |\n| --- | --- | ---: | ---: |\n");
  for (const bool is_chain : {true, false}) {
    World world = bodies_on_rods(is_chain);
    for (int i = 0; i < kSteps; ++i) world.step();
    const char* const scene = is_chain ? "a chain of 1000 rods" : "1000 pendula";
    print(scene, "copy", cost_of(world, [](const World& from, World* to) { *to = from; }));
    print(scene, "snapshot",
          cost_of(world, [](const World& from, World* to) { from.take_snapshot(to); }));
  }
}

// Random scenes of rods, ropes, springs and balls, each by all methods and in several guises,
// against a reference in long double. Prints a line for each finding, from which the scene can be
// made again with --only SEED, and a table; arguments are those of judge_program.h, 600 scenes
// unless --scenes.

#include "judge_program.h"

int main(int argc, char** argv) {
  namespace random_scenes = constraint_sim::engine::random_scenes;
  return random_scenes::main_of(argc, argv, 600, [](std::uint64_t seed, const std::string& only) {
    return random_scenes::judge_seed(seed, only);
  });
}

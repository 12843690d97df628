// Malicious or broken texts: each is loaded or rejected at once, with one line.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "memory_peak.h"
#include "sanitized.h"
#include "temporary_folder.h"
#include "test_paths.h"

namespace constraint_sim::engine {
namespace {

/// Returns the error of load_scene; empty when the text loads.
std::string answer_to(const std::string& text) {
  try {
    load_scene(text, "s");
  } catch (const SceneError& error) {
    return error.what();
  }
  return "";
}

/// Returns processor time of this process: others share the processor.
double seconds_of(const std::function<void()>& action) {
  const std::clock_t start = std::clock();
  action();
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

std::string repeated(const std::string& text, std::size_t count) {
  std::string all;
  for (std::size_t i = 0; i < count; ++i) all += text;
  return all;
}

/// Fails where an action takes more than 5 s of processor time and more than 20 times as long as a
/// list of numbers of the greatest length. Other processes and sanitizers slow down both; unbounded
/// work takes hours.
void expect_at_once(const std::function<void()>& action, const std::string& what) {
  const double seconds = seconds_of(action);
  if (seconds < 5.0) return;
  const std::string numbers = "bodies: [" + repeated("1,", kMostSceneBytes / 2 - 5) + "]";
  EXPECT_LT(seconds, 20.0 * seconds_of([&] { answer_to(numbers); })) << what.substr(0, 200);
}

/// Expects an answer of one line that quotes at most 40 characters.
void expect_short(const std::string& answer, const std::string& text) {
  EXPECT_LE(answer.size(), 300u) << text.substr(0, 80);
  EXPECT_EQ(answer.find('\n'), std::string::npos) << answer;
}

// yaml-cpp 0.7 finds documents without end in the first of these texts.
TEST(HostileScene, OfMoreThanOneDocumentIsRefused) {
  for (const char* text : {",", ", ,", "a,\n,", "]", "}", "world: {}\n---\nworld: {}", "--- ---",
                           "world: {}\n...\nworld: {}", "{},"})
    EXPECT_NE(answer_to(text), "") << text;
}

// yaml-cpp 0.6 finds empty scalars without end in the first five texts.
TEST(HostileScene, WithAColonBeforeABracketOrTheEndIsAnswered) {
  for (const char* text : {"{:", " -\t{:", "!& {1@:", "[{. \n:].", "bodies: [a:]"})
    EXPECT_NE(answer_to(text), "") << text;
  EXPECT_EQ(answer_to("bodies: [{name: a},\n a:]"), "s:2: expected a space between ':' and ']'");
  EXPECT_EQ(answer_to(std::string("bodies: []\n\0", 12)),
            "s:2: not valid YAML: a control character in UTF-8");
  EXPECT_EQ(answer_to("world:"), answer_to("world:\n"));
}

TEST(HostileScene, MayHaveAColonBeforeABracketInACommentOrInQuotes) {
  EXPECT_EQ(answer_to("bodies: []  # [none:]\n"), "");
  const auto answer_to_name = [](const std::string& name) {
    return answer_to("bodies: [{name: " + name + ", mass: 1}]");
  };
  EXPECT_NE(answer_to_name("'[a:]'").find("[a:]"), std::string::npos);
  EXPECT_EQ(answer_to_name("'[a:]'"), answer_to_name("\"[a:\\x5d\""));
}

TEST(HostileScene, IsAnsweredAtOnceHoweverItNests) {
  for (const char* opening : {"[", "{", "[[{", "{a: ", "- ", "? ", "? - ", "[? ", "a: [", "&a [",
                              "!t [", "!!seq [", "[*a, ", "{[", "- - ? ", "[a: "}) {
    for (const std::size_t count : {40u, 1000u, 100000u}) {
      const std::string text = repeated(opening, count);
      std::string answer;
      expect_at_once([&] { answer = answer_to(text); }, opening);
      EXPECT_NE(answer, "") << opening;
      expect_short(answer, text);
    }
  }
  // deep by indentation
  std::string text;
  for (std::size_t i = 0; i < 2000; ++i) text += std::string(i, ' ') + "a:\n";
  EXPECT_EQ(answer_to(text), "s:33: lists and maps more than 32 deep");
}

TEST(HostileScene, OfAliasesIsAnsweredAtOnce) {
  // 2^60 elements if they were copied
  std::string laughs = "a0: &a0 [1, 1]\n";
  for (int i = 1; i < 60; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    laughs += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + before + ", " + before +
              "]\n";
  }
  EXPECT_EQ(answer_to(laughs), "s:1: unknown key 'a0'");
  EXPECT_EQ(answer_to("bodies: &a [*a, *a]"), "s:1: an alias within its own anchor");
  EXPECT_EQ(answer_to("world: &a {gravity: *a}"), "s:1: an alias within its own anchor");
  EXPECT_NE(answer_to("bodies: *none"), "");
  EXPECT_EQ(answer_to("bodies: [&a {name: a, mass: 1}, *a]"),
            "s:1: bodies[1].name: there is already a body named 'a'");
  // ordinary use
  const World world = load_scene(
      "bodies:\n  - {name: a, mass: &m 2, shape: &s {sphere: {radius: 0.5}}}\n"
      "  - {name: b, mass: *m, shape: *s}\n");
  EXPECT_EQ(world.body(world.find_body("b")).mass, 2.0);
  EXPECT_EQ(std::get<Sphere>(world.body(world.find_body("b")).shape).radius, 0.5);
}

/// Returns a map with as many different keys as fit.
std::string many_keys(std::size_t size) {
  std::string text;
  for (std::size_t i = 0; text.size() + 20 < size; ++i) text += "k" + std::to_string(i) + ": 1\n";
  return text;
}

// Texts of the greatest allowed length.
TEST(HostileScene, OfGreatLengthIsAnsweredAtOnce) {
  const std::size_t size = kMostSceneBytes / (kIsLongRun ? 1 : 4) / kSanitizedShare;
  const auto filled = [size](const std::string& before, const std::string& piece,
                             const std::string& after = "") {
    return before + repeated(piece, (size - before.size() - after.size()) / piece.size()) + after;
  };
  const std::vector<std::string> texts{
      filled("bodies: [", "x, ", "]"),
      filled("bodies: [", "[],", "]"),
      filled("bodies: [", "1,", "]"),
      filled("bodies: [", "{name: a},", "]"),
      filled("bodies: [&a {}, ", "*a, ", "]"),
      filled("", "a: 1\n"),
      many_keys(size),
      filled("bodies:\n", "- a\n"),
      filled("bodies:\n", "- {a: 1}\n"),
      filled("bodies:\n", "- [1,2,3]\n"),
      filled("world: {method: ", "x", "}"),
      filled("world: {method: \"", "x", "\"}"),
      filled("world: {method: |\n", "  xxxx\n"),
      filled("world: ", "x\n "),
      filled("", " "),
      filled("", "#\n"),
      filled("", "\n"),
      filled("", "\t"),
      std::string(size, '\0'),
      filled("", "&a "),
      filled("", "!"),
      filled("", "%TAG ! x\n"),
      filled("", "-"),
      filled("", "? "),
      filled("", "'"),
      filled("'", "''"),
      filled("\"", "\\u0041"),
  };
  const MemoryPeak memory;
  for (const std::string& text : texts) {
    std::string answer;
    expect_at_once([&] { answer = answer_to(text); }, text);
    EXPECT_NE(answer, "") << text.substr(0, 40);
    expect_short(answer, text);
  }
  // twice the measured value; sanitizers need memory of their own
  EXPECT_LT(memory.grown_by(), kSanitizedShare > 1 ? 2e9 : 5e8);
  EXPECT_EQ(answer_to(std::string(kMostSceneBytes + 1, ' ')),
            "s: must be at most 6291456 bytes, got 6291457");
}

// The bounds allow 10 000 moving bodies as saved, with all digits of every number.
TEST(HostileScene, BoundsLeaveRoomForTenThousandBodies) {
  World world;
  for (int i = 0; i < 10000; ++i) {
    Body body;
    body.name = "body_" + std::to_string(i);
    body.mass = 1.0;
    body.shape = Sphere{0.1};
    body.state.position = {i / 3.0, i / 7.0, 1.0 / (i + 3.0)};
    body.state.orientation = Eigen::Quaterniond(1.0, 0.1, i / 11.0, 0.3).normalized();
    body.state.linear_velocity = {i / 3.0, 1.0 / 7.0, i / 13.0};
    body.state.angular_velocity = {i / 17.0, i / 19.0, 1.0 / 23.0};
    world.add_body(body);
  }
  const std::string text = save_scene(world);
  EXPECT_LT(text.size(), kMostSceneBytes);
  EXPECT_EQ(load_scene(text).body_ids().size(), world.body_ids().size());
}

// ---- random texts

class Noise {
 public:
  explicit Noise(unsigned seed) : engine_(seed) {}

  std::size_t below(std::size_t count) { return engine_() % count; }

  std::string bytes(std::size_t size) {
    std::string text;
    for (std::size_t i = 0; i < size; ++i) text += static_cast<char>(engine_() & 0xffU);
    return text;
  }
  /// Returns characters and words that YAML consists of.
  std::string marks(std::size_t size) {
    static const std::vector<std::string> kMarks{
        ",",  "[",   "]",   "{",  "}", ":",    ": ",     "- ",    "? ",    "&a ",    "*a",  "!",
        "|",  ">",   "'",   "\"", "#", "%",    "@",      "`",     "\n",    "\n  ",   " ",   "\t",
        "~",  "---", "...", "<<", "a", "1",    "-1e300", ".inf",  ".nan",  "world",  "0x7", "\r",
        "\\", "\0",  "!!s", "  ", "é", "null", "bodies", "name:", "mass:", "shape:", "=",   "--- "};
    std::string text;
    while (text.size() < size) text += kMarks[below(kMarks.size())];
    return text;
  }
  std::string mutation_of(std::string text) {
    for (std::size_t i = 1 + below(6); i > 0 && !text.empty(); --i) {
      const std::size_t at = below(text.size());
      const std::size_t length = 1 + below(20);
      switch (below(5)) {
        case 0:
          text.erase(at, length);
          break;
        case 1:
          text.insert(at, marks(length));
          break;
        case 2:
          text.insert(at, text.substr(below(text.size()), 10 * length));
          break;
        case 3:
          text[at] = static_cast<char>(engine_() & 0xffU);
          break;
        default:
          text.insert(at, "1e" + std::to_string(below(400)));
      }
    }
    return text;
  }

 private:
  std::mt19937 engine_;
};

std::vector<std::string> shipped_texts() {
  std::vector<std::string> texts;
  for (const std::string& name : scene_names(CONSTRAINT_SIM_SCENE_DIR)) {
    std::ifstream file(CONSTRAINT_SIM_SCENE_DIR "/" + name + ".yaml");
    std::ostringstream text;
    text << file.rdbuf();
    texts.push_back(text.str());
  }
  return texts;
}

// A text that loads is also stepped once: no accepted text ends the process.
TEST(HostileScene, OfRandomTextIsAnsweredAtOnce) {
  Noise noise(20);
  const std::vector<std::string> shipped = shipped_texts();
  int loaded = 0;
  for (std::size_t i = 0; i < 8000; ++i) {
    std::string text;
    if (i % 3 == 0) text = noise.bytes(noise.below(200));
    if (i % 3 == 1) text = noise.marks(noise.below(200));
    if (i % 3 == 2) text = noise.mutation_of(shipped[i / 3 % shipped.size()]);
    const auto load_and_step = [&] {
      try {
        World world = load_scene(text, "s");
        ++loaded;
        world.step();
      } catch (const SceneError& error) {
        expect_short(error.what(), text);
      }
    };
    expect_at_once(load_and_step, text);
  }
  EXPECT_GT(loaded, 100);  // mutations of comments and numbers
}

// ---- files

class HostileFile : public testing::Test {
 protected:
  std::string in_folder(const std::string& name) const { return folder_.path() + "/" + name; }

  static std::string answer_to_file(const std::string& path) {
    try {
      load_scene_file(path);
    } catch (const SceneError& error) {
      return error.what();
    }
    return "";
  }

 private:
  TemporaryFolder folder_;
};

TEST_F(HostileFile, ThatIsNoneIsRefusedAtOnce) {
  ASSERT_EQ(mkfifo(in_folder("pipe").c_str(), 0600), 0);
  std::filesystem::create_symlink("/dev/zero", in_folder("zeros"));
  for (const std::string& path : {in_folder("pipe"), std::string("/dev/zero"), in_folder("zeros"),
                                  std::string("/dev/tty"), in_folder(".")}) {
    std::string answer;
    expect_at_once([&] { answer = answer_to_file(path); }, path);
    EXPECT_EQ(answer.rfind(path + ": cannot read this", 0), 0u) << answer;
  }
}

TEST_F(HostileFile, ThatIsTooLongIsNotRead) {
  std::ofstream(in_folder("long.yaml")) << "bodies: []\n";
  std::filesystem::resize_file(in_folder("long.yaml"), std::uintmax_t{1} << 40);
  EXPECT_EQ(answer_to_file(in_folder("long.yaml")),
            in_folder("long.yaml") + ": must be at most 6291456 bytes, got 1099511627776");
}

TEST_F(HostileFile, OfASceneIsFoundByNameOrPath) {
  for (const char* name : {"pendulum", "double_pendulum", "bridge"})
    std::ofstream(in_folder(std::string(name) + ".yaml")) << "bodies: []\n";
  std::ofstream(in_folder("notes.txt")) << "none\n";
  const std::string folder = in_folder(".");
  EXPECT_EQ(scene_names(folder),
            (std::vector<std::string>{"bridge", "double_pendulum", "pendulum"}));
  EXPECT_EQ(file_of_scene("pendulum", folder), folder + "/pendulum.yaml");
  EXPECT_EQ(file_of_scene("./other.yaml", folder), "./other.yaml");
  EXPECT_EQ(file_of_scene("pendulum", in_folder("none")), "pendulum");
  const auto refusal = [&](const std::string& name) -> std::string {
    try {
      return file_of_scene(name, folder);
    } catch (const SceneError& error) {
      return error.what();
    }
  };
  EXPECT_EQ(refusal("pendlum"), "pendlum: there is no such file or scene; did you mean pendulum?");
  EXPECT_EQ(refusal("xyz"),
            "xyz: there is no such file or scene; there are bridge, double_pendulum, pendulum");
  expect_short(refusal(std::string(100000, 'x')), "");
}

}  // namespace
}  // namespace constraint_sim::engine

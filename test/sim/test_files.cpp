// Files named by callers: only regular ones, complete or not at all, and only in the allowed
// folder.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "sim/files.h"

namespace constraint_sim {
namespace {

namespace fs = std::filesystem;

class Files : public ::testing::Test {
 protected:
  Files() {
    std::string name = (fs::temp_directory_path() / "files.XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
  }
  ~Files() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return folder_ + "/" + name; }
  void make(const std::string& name, const std::string& text) const {
    std::ofstream(path(name)) << text;
  }
  std::size_t entries() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }
  template <class Work>
  static void expect_refused(const std::string& word, Work work) {
    try {
      work();
      ADD_FAILURE() << "accepted what should be refused with " << word;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  }

  std::string folder_;
};

TEST_F(Files, WhatIsNoRegularFileIsNotRead) {
  ASSERT_EQ(::mkfifo(path("fifo").c_str(), 0600), 0);
  expect_refused("regular", [&] { read_file(path("fifo")); });
  expect_refused("regular", [&] { read_file("/dev/zero"); });
  expect_refused("directory", [&] { read_file(folder_); });
  expect_refused("No such file", [&] { read_file(path("nothing")); });
  expect_refused("zero byte", [&] { read_file(path("a") + std::string(1, '\0')); });
}

TEST_F(Files, AFileOfMoreThanTheMostIsNotRead) {
  make("small", "text");
  EXPECT_EQ(read_file(path("small")), "text");
  fs::create_symlink(path("small"), path("link"));
  EXPECT_EQ(read_file(path("link")), "text");
  make("large", "");
  fs::resize_file(path("large"), kMostBytes);
  EXPECT_EQ(read_file(path("large")).size(), kMostBytes);
  fs::resize_file(path("large"), kMostBytes + 1);
  expect_refused("MiB", [&] { read_file(path("large")); });
}

TEST_F(Files, AFileIsReplacedAndKeepsItsMode) {
  write_file(path("a"), "first");
  EXPECT_EQ(read_file(path("a")), "first");
  ASSERT_EQ(::chmod(path("a").c_str(), 0640), 0);
  write_file(path("a"), "second");
  EXPECT_EQ(read_file(path("a")), "second");
  EXPECT_EQ(fs::status(path("a")).permissions(), fs::perms(0640));
  EXPECT_EQ(entries(), 1u);
}

TEST_F(Files, NothingElseIsReplaced) {
  ASSERT_EQ(::mkfifo(path("fifo").c_str(), 0600), 0);
  expect_refused("regular", [&] { write_file(path("fifo"), "x"); });
  expect_refused("regular", [&] { write_file("/dev/null", "x"); });
  expect_refused("directory", [&] { write_file(folder_, "x"); });
  expect_refused("No such file", [&] { write_file(path("no_folder/a"), "x"); });
  fs::create_symlink(path("nowhere"), path("dangling"));
  expect_refused("dangling", [&] { write_file(path("dangling"), "x"); });
  EXPECT_FALSE(fs::exists(path("nowhere")));
  EXPECT_EQ(entries(), 2u);
}

TEST_F(Files, ALinkStaysAndItsFileIsReplaced) {
  make("target", "old");
  fs::create_symlink("target", path("link"));
  write_file(path("link"), "new");
  EXPECT_TRUE(fs::is_symlink(path("link")));
  EXPECT_EQ(read_file(path("target")), "new");
}

TEST_F(Files, AnOldNameForUnfinishedFilesIsNotFollowed) {
  make("precious", "precious");
  fs::create_symlink("precious", path("a.unfinished"));
  write_file(path("a"), "text");
  EXPECT_EQ(read_file(path("precious")), "precious");
  EXPECT_EQ(read_file(path("a")), "text");
}

TEST_F(Files, TwoWhoWriteAtOnceDoNotTearIt) {
  const std::string a(300000, 'a'), b(300000, 'b');
  write_file(path("both"), a);
  std::atomic<int> running{2};
  std::vector<std::thread> writers;
  for (const std::string& text : {a, b})
    writers.emplace_back([&, text] {
      for (int i = 0; i < 20; ++i) write_file(path("both"), text);
      --running;
    });
  while (running > 0) {
    const std::string found = read_file(path("both"));
    ASSERT_TRUE(found == a || found == b);
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(entries(), 1u);
}

TEST_F(Files, PathsStayBelowAFolder) {
  fs::create_directory(path("scenes"));
  fs::create_directory(path("scenes/deep"));
  make("scenes/a", "a");
  make("secret", "secret");
  const std::string top = path("scenes");
  EXPECT_EQ(path_below(top, "a"), fs::canonical(top).string() + "/a");
  EXPECT_EQ(path_below(top, top + "/deep/new"), fs::canonical(top).string() + "/deep/new");
  for (const std::string& bad :
       {std::string("../secret"), path("secret"), std::string("/etc/passwd"),
        std::string("deep/../../secret"), path("scenes_2"), std::string(""), std::string("deep/.."),
        std::string("..")})
    expect_refused("scene_folder", [&] { path_below(top, bad); });
  // a link out of the folder, to a file or a folder
  fs::create_symlink(path("secret"), path("scenes/out"));
  fs::create_symlink(folder_, path("scenes/up"));
  expect_refused("scene_folder", [&] { path_below(top, "out"); });
  expect_refused("scene_folder", [&] { path_below(top, "up/secret"); });
  expect_refused("scene_folder", [&] { path_below(top, "up/new"); });
  // a link within the folder
  fs::create_symlink("a", path("scenes/within"));
  EXPECT_EQ(path_below(top, "within"), fs::canonical(top).string() + "/a");
}

}  // namespace
}  // namespace constraint_sim

#include "service/export/movie_writer.h"

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "service/export/process.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::exports {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using ::fovea::testing::TemporaryFolder;

class MovieTest : public ::testing::Test {
 protected:
  void SetUp() override { std::signal(SIGPIPE, SIG_IGN); }

  /// What ffprobe says of the first video stream.
  static std::string Probe(const std::string& path, const std::string& entries) {
    const auto result =
        RunProgram({"ffprobe", "-v", "error", "-count_frames", "-select_streams", "v:0",
                    "-show_entries", "stream=" + entries, "-of", "csv=p=0", path});
    EXPECT_OK(result);
    return result.ok() ? result->output : "";
  }

  /// A program called ffmpeg that does what `script` says, first on the PATH while this lives.
  class FakeFfmpeg {
   public:
    FakeFfmpeg(const TemporaryFolder& folder, const std::string& script)
        : old_path_(std::getenv("PATH")) {
      const std::string path = folder / "ffmpeg";
      std::ofstream(path) << "#!/bin/sh\n" << script << "\n";
      fs::permissions(path, fs::perms::owner_all);
      ::setenv("PATH", (folder.path() + ":" + old_path_).c_str(), 1);
    }
    ~FakeFfmpeg() { ::setenv("PATH", old_path_.c_str(), 1); }

   private:
    std::string old_path_;
  };
};

TEST_F(MovieTest, HasEveryFrameAndEvenSizes) {
  const TemporaryFolder folder;
  for (const char* name : {"a: b's.mp4", "b.mov", "c.webm"}) {
    const std::string path = folder / name;
    ASSERT_OK(MovieWriter::CheckEncoder(path));
    ASSERT_OK_AND_ASSIGN(const auto writer, MovieWriter::Open(path, 33, 17, 12.5));
    for (int frame = 0; frame < 5; ++frame) {
      ASSERT_OK(writer->Write(std::string(size_t{33} * 17 * 4, static_cast<char>(40 * frame))));
    }
    EXPECT_FALSE(fs::exists(path));
    ASSERT_OK(writer->Finish());
    EXPECT_EQ(Probe(path, "width,height,r_frame_rate,nb_read_frames"), "34,18,25/2,5\n") << name;
  }
}

TEST_F(MovieTest, AnUnfinishedOneLeavesNothing) {
  const TemporaryFolder folder;
  {
    ASSERT_OK_AND_ASSIGN(const auto writer, MovieWriter::Open(folder / "a.mp4", 16, 16, 24));
    ASSERT_OK(writer->Write(std::string(1024, 'x')));
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST_F(MovieTest, ShowsWhatFfmpegSaid) {
  const TemporaryFolder folder;
  const FakeFfmpeg fake(folder, "echo 'no such thing' >&2; exit 3");
  ASSERT_OK_AND_ASSIGN(const auto writer, MovieWriter::Open(folder / "a.mp4", 16, 16, 24));
  Status status;
  for (int i = 0; i < 1000 && status.ok(); ++i) {  // until the pipe is full or closed
    status = writer->Write(std::string(1 << 16, 'x'));
  }
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kFailedPrecondition, "(exit status 3): no such"));
}

TEST_F(MovieTest, AnErrorWithStatusZeroIsAnError) {
  const TemporaryFolder folder;
  const FakeFfmpeg fake(folder, "cat > /dev/null; echo 'No space left on device' >&2");
  ASSERT_OK_AND_ASSIGN(const auto writer, MovieWriter::Open(folder / "a.mp4", 16, 16, 24));
  EXPECT_THAT(writer->Finish(), FailsWith(absl::StatusCode::kFailedPrecondition, "No space left"));
  EXPECT_FALSE(fs::exists(folder / "a.mp4"));
}

TEST_F(MovieTest, SaysWhatToInstall) {
  const TemporaryFolder folder;
  {
    const FakeFfmpeg fake(folder, "echo ' V..... libtheora  Theora'");
    EXPECT_THAT(MovieWriter::CheckEncoder("a.mp4"),
                FailsWith(absl::StatusCode::kNotFound, "has no encoder libx264"));
  }
  const std::string old_path = std::getenv("PATH");
  ::setenv("PATH", (folder / "nothing").c_str(), 1);
  const Status missing = MovieWriter::CheckEncoder("a.mp4");
  ::setenv("PATH", old_path.c_str(), 1);
  EXPECT_THAT(missing, FailsWith(absl::StatusCode::kNotFound, "apt-get install ffmpeg"));
}

}  // namespace
}  // namespace fovea::exports

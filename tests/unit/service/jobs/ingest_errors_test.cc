#include "service/jobs/ingest_errors.h"

#include <gtest/gtest.h>

namespace fovea::jobs {
namespace {

TEST(IngestErrorsTest, AnErrorIsOfTheFileThatItBeginsWith) {
  const std::vector<std::string> files = {"a/x.vdb", "a/x.vdb: b", "y.raw"};
  EXPECT_EQ(FailureOf("a/x.vdb: ended early", files), (Failure{"a/x.vdb", "ended early"}));
  EXPECT_EQ(FailureOf("a/x.vdb: b: it is odd", files), (Failure{"a/x.vdb: b", "it is odd"}));
  EXPECT_EQ(FailureOf("no file of the series has a grid 'y.raw'", files), std::nullopt);
  EXPECT_EQ(FailureOf("a/x.vdb", files), std::nullopt);
  EXPECT_EQ(FailureOf("y.rawer: no", files), std::nullopt);
  EXPECT_EQ(FailureOf("", files), std::nullopt);
}

TEST(IngestErrorsTest, FlagsThatJobsDoNotHaveAreToldApart) {
  for (const char* text :
       {"", "--", "a--b.vdb: odd", "--lossless: no", "leave it out with --on-missing skip",
        "(--grid of VDB files, --field of others)"}) {
    EXPECT_EQ(ForJobs(text), text);
  }
  EXPECT_EQ(
      ForJobs("name another, or add to it (--append)"),
      "name another, or add to it (--append); a job has no --append: `fovea ingest`, where the "
      "files are, has");
  EXPECT_EQ(ForJobs("--worker-memory, --raw, --extent or --worker-memory"),
            "--worker-memory, --raw, --extent or --worker-memory; a job has no --worker-memory, "
            "--extent: `fovea ingest`, where the files are, has");
}

}  // namespace
}  // namespace fovea::jobs

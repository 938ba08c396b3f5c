#include "service/access/token_file.h"

#include <sys/stat.h>

#include <fstream>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::access {
namespace {

using ::fovea::testing::FailsWith;

// SHA-256 of "abc" and of "" (FIPS 180-4).
constexpr char kAbc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr char kEmpty[] = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

std::string Entry(const std::string& more = "", const std::string& sha256 = kAbc,
                  const std::string& name = "lab") {
  return R"({"name": ")" + name + R"(", "sha256": ")" + sha256 +
         R"(", "prefix": "lab/scans", "rights": "read")" + more + "}";
}

std::string File(const std::string& entries) {
  return R"({"tokens": [)" + entries + "]}";
}

TEST(TokenFileTest, ReadsWhatADigestStandsFor) {
  ASSERT_OK_AND_ASSIGN(const auto tokens,
                       ParseTokens(File(Entry(R"(, "streams": 4, "pixels_per_second": 2e7)") + "," +
                                        Entry("", kEmpty, "other"))));
  ASSERT_EQ(tokens.size(), 2U);
  EXPECT_EQ(tokens[0].name, "lab");
  EXPECT_TRUE(SameDigest(tokens[0].digest, DigestOf("abc")));
  EXPECT_TRUE(SameDigest(tokens[1].digest, DigestOf("")));
  EXPECT_FALSE(SameDigest(tokens[1].digest, DigestOf("abc")));
  EXPECT_EQ(tokens[0].prefix, "lab/scans");
  EXPECT_EQ(tokens[0].right, Right::kRead);
  EXPECT_EQ(tokens[0].quotas, (Quotas{4, 2e7, 0}));
  ASSERT_OK_AND_ASSIGN(const auto again, ParseTokens(FormatTokens(tokens)));
  EXPECT_EQ(again, tokens);
}

TEST(TokenFileTest, SaysWhichEntryIsWrong) {
  const auto fails = [](const std::string& text, const char* why) {
    EXPECT_THAT(ParseTokens(text), FailsWith(absl::StatusCode::kInvalidArgument, why)) << text;
  };
  for (const char* text :
       {"", "[]", "{}", R"({"tokens": 3})", R"({"tokens": [], "x": 1})", "{\"to"}) {
    fails(text, "{\"tokens\": [...]}");
  }
  fails(File("3"), "tokens[0]: must be an object");
  fails(File(Entry() + "," + Entry()), "tokens[1]: its name or its sha256 is there twice");
  fails(File(Entry() + "," + Entry("", kAbc, "b")), "tokens[1]: its name or its sha256");
  fails(File(Entry(R"(, "stream": 4)")), "there is no key 'stream'");
  fails(File(Entry("", "abc")), "'sha256'");
  fails(File(Entry("", std::string(62, 'a') + "0x")), "'sha256'");
  fails(File(Entry("", kAbc, "a b")), "'name'");
  fails(File(Entry("", kAbc, "")), "'name'");
  fails(File(R"({"name": "a"})"), "'sha256' is missing");
  fails(File(Entry(R"(, "streams": 0)")), "'streams'");
  fails(File(Entry(R"(, "streams": 1.5)")), "'streams'");
  fails(File(Entry(R"(, "pixels_per_second": -1)")), "'pixels_per_second'");
  fails(File(Entry(R"(, "bytes_in_per_second": "1")")), "'bytes_in_per_second'");
  std::string bad = File(Entry());
  bad.replace(bad.find("lab/scans"), 9, "/lab");
  fails(bad, "'prefix'");
  bad = File(Entry());
  bad.replace(bad.find("\"read\""), 6, "\"all\"");
  fails(bad, "'rights'");
}

TEST(TokenFileTest, IsWrittenWholeAndForItsOwnerAlone) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "tokens.json";
  EXPECT_THAT(ReadTokenFile(path), FailsWith(absl::StatusCode::kNotFound, path.c_str()));
  Token token;
  token.name = "lab";
  token.digest = DigestOf("abc");
  ASSERT_OK(WriteTokenFile(path, {token}));
  ASSERT_OK_AND_ASSIGN(const auto tokens, ReadTokenFile(path));
  EXPECT_EQ(tokens, std::vector<Token>{token});
  struct stat info {};
  ASSERT_EQ(stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
  std::ofstream(path) << "{";
  EXPECT_THAT(ReadTokenFile(path), FailsWith(absl::StatusCode::kInvalidArgument, path.c_str()));
}

TEST(TokenFileTest, APrefixThatCanMatchNothingIsRefused) {
  Token token;
  token.name = "a";
  for (const char* prefix : {"lab/\xFF", "../x", "lab/..", "lab//a", "/lab", "lab/", ".lab"}) {
    token.prefix = prefix;
    EXPECT_THAT(CheckToken(token), FailsWith(absl::StatusCode::kInvalidArgument, "'prefix'"));
  }
  token.prefix = "lab/a.b/\xC3\xBC c";
  EXPECT_OK(CheckToken(token));
}

TEST(TokenTest, TokensAreLongAndNeverTheSame) {
  ASSERT_OK_AND_ASSIGN(const std::string one, MakeToken());
  ASSERT_OK_AND_ASSIGN(const std::string two, MakeToken());
  EXPECT_NE(one, two);
  EXPECT_EQ(one.size(), 49U);
  EXPECT_TRUE(one.starts_with("fovea_"));
}

TEST(TokenTest, APrefixIsAFolderOrADataset) {
  EXPECT_TRUE(IsWithin("lab/one", "lab"));
  EXPECT_TRUE(IsWithin("lab", "lab"));
  EXPECT_TRUE(IsWithin("anything", ""));
  EXPECT_FALSE(IsWithin("lab2", "lab"));
  EXPECT_FALSE(IsWithin("la", "lab"));
  EXPECT_FALSE(IsWithin("x/lab", "lab"));
  EXPECT_TRUE(IsWithin("lab/a/b", "lab/a"));
}

}  // namespace
}  // namespace fovea::access

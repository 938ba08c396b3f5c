#include "ingest/sensors/reading_parser.h"

#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
constexpr auto kBad = absl::StatusCode::kInvalidArgument;

/// Everything about one parse.
struct Parsed {
  Status status;
  ReadingBlock block;
  std::vector<std::string> names;
  BadLines bad;
};

struct Input {
  ReadingFormat format = ReadingFormat::kCsv;
  ReadingColumns columns;
  int64_t max_bad = 0;
  size_t piece = 0;  // bytes that come at a time; 0: all
};

Parsed Parse(const std::string& text, const Input& input = {}) {
  Parsed parsed;
  parsed.bad.most = input.max_bad;
  StepKeys keys;
  ParserOptions options;
  options.format = input.format;
  options.columns = input.columns;
  options.keys = &keys;
  options.bad = &parsed.bad;
  const auto parser = MakeReadingParser(options, "file");
  std::string waiting;
  const size_t piece = input.piece == 0 ? text.size() + 1 : input.piece;
  for (size_t at = 0; parsed.status.ok(); at += piece) {
    const bool last = at + piece >= text.size();
    waiting += text.substr(std::min(at, text.size()), piece);
    const StatusOr<size_t> taken = parser->Parse(waiting, last, &parsed.block);
    parsed.status = taken.status();
    if (last || !taken.ok()) {
      break;
    }
    waiting.erase(0, *taken);
  }
  parsed.names = parser->value_names();
  return parsed;
}

std::vector<std::vector<double>> Rows(const ReadingBlock& block) {
  std::vector<std::vector<double>> rows;
  const size_t channels = block.readings.empty() ? 1 : block.values.size() / block.readings.size();
  for (size_t i = 0; i < block.readings.size(); ++i) {
    const sensors::Reading& r = block.readings[i];
    rows.push_back({r.x, r.y, r.z, r.time_s});
    for (size_t c = 0; c < channels; ++c) {
      rows.back().push_back(block.values[i * channels + c]);
    }
  }
  return rows;
}

TEST(CsvTest, HeaderNamesTheColumnsInAnyOrder) {
  const Parsed parsed = Parse("dbz,t_s,Z (m),y,Longitude\n7.5,100,3,2,1\n-1e1, 200 ,6,5,+4\n");
  ASSERT_OK(parsed.status);
  EXPECT_THAT(Rows(parsed.block),
              ElementsAre(ElementsAre(1, 2, 3, 100, 7.5), ElementsAre(4, 5, 6, 200, -10)));
  EXPECT_THAT(parsed.names, ElementsAre("dbz"));
}

TEST(CsvTest, QuotesCommentsEmptyLinesByteOrderMarkAndCrLf) {
  const Parsed parsed = Parse(
      "\xef\xbb\xbf# made by a logger\r\n\r\n\"x\",y,\"the \"\"value\"\", in mm\"\r\n"
      "\"1\",2,3\r\n  # more\n   \r\n 4 , \"5\" ,6");
  ASSERT_OK(parsed.status);
  EXPECT_THAT(Rows(parsed.block),
              ElementsAre(ElementsAre(1, 2, 0, 0, 3), ElementsAre(4, 5, 0, 0, 6)));
  EXPECT_THAT(parsed.names, ElementsAre("the \"value\", in mm"));
}

TEST(CsvTest, SeparatorsAreFound) {
  for (const std::string separator : {",", ";", "\t"}) {
    const Parsed parsed =
        Parse("x" + separator + "y" + separator + "v\n1" + separator + "2" + separator + "3\n");
    ASSERT_OK(parsed.status);
    EXPECT_THAT(Rows(parsed.block), ElementsAre(ElementsAre(1, 2, 0, 0, 3)));
  }
}

TEST(CsvTest, WithoutHeaderByNumber) {
  const Parsed five = Parse("1,2,3,4,5\n");
  ASSERT_OK(five.status);
  EXPECT_THAT(Rows(five.block), ElementsAre(ElementsAre(1, 2, 3, 4, 5)));
  Input input;
  EXPECT_THAT(Parse("9,1,2\n").status, FailsWith(kBad, "file:1: no header"));
  input.columns.x = "2";
  input.columns.y = "3";
  input.columns.values = {"1", "2"};
  const Parsed parsed = Parse("9,1,2\n8,3,4\n", input);
  ASSERT_OK(parsed.status);
  EXPECT_THAT(Rows(parsed.block),
              ElementsAre(ElementsAre(1, 2, 0, 0, 9, 1), ElementsAre(3, 4, 0, 0, 8, 3)));
}

TEST(CsvTest, ColumnsByNameAndStepKeys) {
  Input input;
  input.columns.values = {"t2m", "rh"};
  input.columns.step = "scan";
  const Parsed parsed =
      Parse("lat,lon,rh,t2m,scan\n1,2,3,4,night\n5,6,7,8,day\n1,2,3,4,night\n", input);
  ASSERT_OK(parsed.status);
  EXPECT_THAT(Rows(parsed.block),
              ElementsAre(ElementsAre(2, 1, 0, 0, 4, 3), ElementsAre(6, 5, 0, 0, 8, 7),
                          ElementsAre(2, 1, 0, 0, 4, 3)));
  EXPECT_EQ(parsed.block.readings[0].step, 0);
  EXPECT_EQ(parsed.block.readings[1].step, 1);
  EXPECT_EQ(parsed.block.readings[2].step, 0);
  const Parsed numbers = Parse("x,y,v,scan,u\n1,2,3,70,0\n1,2,3,-5,0\n1,2,3,x,0\n",
                               {ReadingFormat::kCsv, {"", "", "", "", "scan", {"v"}}, 0, 0});
  EXPECT_THAT(numbers.status, FailsWith(kBad, "file:4: the step 'x' is no whole number"));
  EXPECT_EQ(numbers.block.readings[1].step, -5);
}

TEST(CsvTest, DoubtIsAnErrorThatListsTheColumns) {
  EXPECT_THAT(Parse("x,y,a,b\n1,2,3,4\n").status,
              FailsWith(kBad, "'x', 'y', 'a', 'b' is the value"));
  EXPECT_THAT(Parse("a,y,v\n1,2,3\n").status, FailsWith(kBad, "is x? Name it with --columns x="));
  Input input;
  input.columns.time = "when";
  EXPECT_THAT(Parse("x,y,v\n1,2,3\n", input).status, FailsWith(kBad, "there is no 'when'"));
}

TEST(CsvTest, BadLinesNameFileAndLineAndAreBorneUpToALimit) {
  const std::string text = "x,y,v\n1,2,3\n1,two,3\n1,2\n4,5,6\n\"1,2,3\n";
  EXPECT_THAT(Parse(text).status, FailsWith(kBad, "file:3: 'two' is no number"));
  Input input;
  input.max_bad = 2;
  EXPECT_THAT(Parse(text, input).status, FailsWith(kBad, "file:6: a quote is not closed"));
  input.max_bad = 3;
  const Parsed parsed = Parse(text, input);
  ASSERT_OK(parsed.status);
  EXPECT_EQ(parsed.bad.count, 3);
  EXPECT_THAT(parsed.bad.first, HasSubstr("file:3"));
  EXPECT_EQ(parsed.block.readings.size(), 2U);
  EXPECT_EQ(parsed.block.values.size(), 2U);
}

TEST(CsvTest, NothingMeasuredIsNan) {
  const Parsed parsed = Parse("x,y,v\n1,2,\n1,2,NA\n1,2,null\n1,2,nan\n1,2,1e999\n1,2,1e-999\n");
  ASSERT_OK(parsed.status);
  for (int i = 0; i < 5; ++i) {
    EXPECT_TRUE(std::isnan(parsed.block.values[i])) << i;
  }
  EXPECT_EQ(parsed.block.values[5], 0);
}

TEST(CsvTest, Times) {
  const auto time_of = [](const std::string& text) {
    const Parsed parsed = Parse("x,y,v,time\n1,2,3," + text + "\n");
    return parsed.status.ok() ? parsed.block.readings.at(0).time_s : -1;
  };
  EXPECT_EQ(time_of("12.5"), 12.5);
  EXPECT_EQ(time_of("1970-01-02"), 86400);
  EXPECT_EQ(time_of("2020-02-07T13:05:00Z"), 1581080700);
  EXPECT_EQ(time_of("2020-02-07 13:05"), 1581080700);
  EXPECT_DOUBLE_EQ(time_of("2020-02-07T14:05:00.25+01:00"), 1581080700.25);
  EXPECT_EQ(time_of("2020-02-07T08:35:00-0430"), 1581080700);
  for (const char* bad :
       {"2020-13-01", "2020-02-30", "2020-02-07T25:00", "noon", "2020-02-07T13:05:00X"}) {
    EXPECT_EQ(time_of(bad), -1) << bad;
  }
}

TEST(CsvTest, AnEndlessLineIsRefused) {
  EXPECT_THAT(Parse(std::string(3 << 20, 'x')).status, FailsWith(kBad, "file:1: a line of more"));
}

TEST(JsonLinesTest, Objects) {
  const Input input{ReadingFormat::kJsonLines, {}, 0, 0};
  const Parsed parsed = Parse(
      "{\"t\": 1, \"x\":2,\"y\" : 3, \"temp\":-4.5e1}\r\n\n"
      "{\"temp\":null,\"y\":6,\"x\":\"5\",\"t\":\"1970-01-01T00:00:09Z\","
      "\"tags\":{\"a\":[1,\"}\"]}}\n"
      "  {\"x\":1,\"x\":7,\"y\":8,\"temp\":9}",
      input);
  ASSERT_OK(parsed.status);
  EXPECT_THAT(parsed.names, ElementsAre("temp"));
  ASSERT_EQ(parsed.block.readings.size(), 3U);
  EXPECT_THAT(Rows(parsed.block)[0], ElementsAre(2, 3, 0, 1, -45));
  EXPECT_EQ(parsed.block.readings[1].x, 5);
  EXPECT_EQ(parsed.block.readings[1].time_s, 9);
  EXPECT_TRUE(std::isnan(parsed.block.values[1]));
  EXPECT_EQ(parsed.block.readings[2].x, 7);
  EXPECT_TRUE(std::isnan(parsed.block.readings[2].time_s));
}

TEST(JsonLinesTest, WhatIsNoObjectIsABadLine) {
  const std::string good = "{\"x\":1,\"y\":2,\"v\":3}\n";
  for (const std::string bad :
       {"[1,2,3]", "{", "{\"x\"}", "{\"x\":}", "{\"x\":1,}", "{\"x\":1 \"y\":2}", "{\"x\":\"1}",
        "{\"x\":[}", "{\"x\":1} x", "{x:1}", "{\"x\":\"\\q\"}", "{\"x\":\"\\u12\"}",
        "{\"x\":true,\"y\":2,\"v\":3}", "1"}) {
    const Parsed parsed = Parse(good + bad + "\n", {ReadingFormat::kJsonLines, {}, 0, 0});
    EXPECT_THAT(parsed.status, FailsWith(kBad, "file:2: ")) << bad;
    EXPECT_EQ(parsed.block.readings.size(), 1U);
  }
  const std::string deep = "{\"x\":" + std::string(100000, '[') + "}\n";
  EXPECT_THAT(Parse(good + deep, {ReadingFormat::kJsonLines, {}, 0, 0}).status,
              FailsWith(kBad, "nested"));
}

TEST(RecordsTest, FiveFloats) {
  const float record[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, NAN};
  std::string bytes(sizeof(record), '\0');
  std::memcpy(bytes.data(), record, sizeof(record));
  const Parsed parsed = Parse(bytes, {ReadingFormat::kRecords, {}, 0, 7});
  ASSERT_OK(parsed.status);
  ASSERT_EQ(parsed.block.readings.size(), 2U);
  EXPECT_THAT(Rows(parsed.block)[0], ElementsAre(1, 2, 3, 4, 5));
  EXPECT_TRUE(std::isnan(parsed.block.values[1]));
  EXPECT_THAT(Parse(bytes + "x", {ReadingFormat::kRecords, {}, 0, 0}).status,
              FailsWith(kBad, "1 bytes that are no whole record"));
}

/// The same readings in three formats, cut into pieces of all sizes, are the same readings.
TEST(AllFormatsTest, AgreeHoweverTheBytesCome) {
  std::mt19937 random(1);
  std::string csv = "x,y,z,t,value\n";
  std::string json, records;
  for (int i = 0; i < 200; ++i) {
    float r[5];
    for (float& part : r) {
      part = (static_cast<float>(random()) - 2e9F) / 1024.0F;
    }
    csv += fmt::format("{},{},{},{},{}\n", r[0], r[1], r[2], r[3], r[4]);
    json += fmt::format("{{\"x\":{},\"y\":{},\"z\":{},\"t\":{},\"value\":{}}}\n", r[0], r[1], r[2],
                        r[3], r[4]);
    records.append(reinterpret_cast<const char*>(r), sizeof(r));
  }
  const Parsed want = Parse(records, {ReadingFormat::kRecords, {}, 0, 0});
  ASSERT_EQ(want.block.readings.size(), 200U);
  for (const size_t piece : {size_t{0}, size_t{1}, size_t{13}, size_t{4096}}) {
    const Parsed lines = Parse(csv, {ReadingFormat::kCsv, {}, 0, piece});
    const Parsed objects = Parse(json, {ReadingFormat::kJsonLines, {}, 0, piece});
    ASSERT_OK(lines.status);
    ASSERT_OK(objects.status);
    // The shortest text of a float is not that float as a double: equal as floats.
    const auto floats = [](const Parsed& parsed) {
      std::vector<float> all;
      for (const auto& row : Rows(parsed.block)) {
        all.insert(all.end(), row.begin(), row.end());
      }
      return all;
    };
    EXPECT_EQ(floats(lines), floats(want));
    EXPECT_EQ(floats(objects), floats(want));
  }
}

/// Whatever comes, a parser answers: mutated files never crash it.
TEST(AllFormatsTest, MutatedBytesAreBorne) {
  std::mt19937 random(2);
  const std::string csv = "x,y,v,t\n1,2,3,2020-01-01T00:00:00Z\n\"4\",5,6,7\n";
  const std::string json = "{\"x\":1,\"y\":2,\"v\":\"3\\n\",\"n\":{\"a\":[1]}}\n";
  for (int i = 0; i < 20000; ++i) {
    std::string text = i % 2 == 0 ? csv : json;
    for (uint32_t m = 0; m < 1 + random() % 6; ++m) {
      const size_t at = random() % text.size();
      switch (random() % 3) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, random() % 8);
          text += ',';
          break;
        default:
          text.insert(at, text.substr(random() % text.size(), random() % 12));
      }
    }
    const auto format = static_cast<ReadingFormat>(random() % 3);
    const Parsed parsed = Parse(text, {format, {}, 2, random() % 20});
    ASSERT_EQ(parsed.block.values.size(), parsed.block.readings.size());
  }
}

}  // namespace
}  // namespace fovea::ingest

#include "service/cli/foreign_flags.h"

#include <algorithm>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "ingest/file_format.h"
#include "service/cli/picture_source.h"

namespace fovea::cli {
namespace {

using ingest::FileFormat;

/// A flag that says something of one kind of files, or of all but VDB.
struct KindFlag {
  const char* flag;
  FileFormat only;  // kUnknown: all but VDB
  const char* kind;
};

constexpr KindFlag kKindFlags[] = {
    {"--grid", FileFormat::kVdb, "VDB files"},
    {"--axes", FileFormat::kNpy, "NumPy files"},
    {"--slices", FileFormat::kPicture, "pictures"},
    {"--spacing", FileFormat::kUnknown, "files that are not VDB, which say it themselves"},
    {"--channel", FileFormat::kUnknown, "files that are not VDB (of vector grids: --grid NAME.x)"},
};
/// `ingest` only: other verbs choose a field with it.
constexpr KindFlag kNameFlag = {"--field", FileFormat::kUnknown,
                                "files that are not VDB, whose grids have names (--grid)"};

bool Applies(const KindFlag& flag, FileFormat format) {
  return format == FileFormat::kUnknown ||
         (flag.only == FileFormat::kUnknown ? format != FileFormat::kVdb : format == flag.only);
}

void Refuse(const KindFlag& flag, const CLI::App& verb, const std::vector<FileFormat>& formats) {
  const bool applies = std::any_of(formats.begin(), formats.end(),
                                   [&](FileFormat format) { return Applies(flag, format); });
  if (!applies && !formats.empty() && verb.count(flag.flag) > 0) {
    throw CLI::ValidationError(flag.flag, fmt::format("is for {}", flag.kind));
  }
}

}  // namespace

void RefuseFlagsOfOtherFiles(const CLI::App& verb, const std::vector<std::string>& inputs) {
  std::vector<FileFormat> formats;
  for (const std::string& input : inputs) {
    formats.push_back(verb.count("--raw") > 0 ? FileFormat::kRaw : ingest::FormatByName(input));
  }
  for (const KindFlag& flag : kKindFlags) {
    Refuse(flag, verb, formats);
  }
  if (verb.get_name() == "ingest") {
    Refuse(kNameFlag, verb, formats);
  }
}

void RefuseForeignFlags(const CLI::App& verb, const std::vector<std::string>& inputs) {
  const bool of_server = verb.count("--server") > 0;
  if (!of_server && !NamesDataset(inputs)) {
    RefuseFlagsOfOtherFiles(verb, inputs);
    return;
  }
  for (const CLI::Option* option : verb.get_options()) {
    if (option->get_group() == kForeignGroup && option->count() > 0) {
      throw CLI::ValidationError(
          option->get_name(),
          fmt::format("says how foreign files are read, and {}",
                      of_server ? "--server has datasets"
                                : fmt::format("'{}' is a dataset", inputs.front())));
    }
  }
}

}  // namespace fovea::cli

#include "service/export/manifest.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "service/export/output_file.h"

namespace fovea::exports {

namespace fs = std::filesystem;

Manifest::Manifest(const std::string& folder_and_stem, std::string settings)
    : text_(std::move(settings)) {
  const fs::path where(folder_and_stem);
  path_ = (where.parent_path() / fmt::format(".{}.fovea-export.json", where.filename().string()))
              .string();
}

Manifest::State Manifest::Check() const {
  std::ifstream file(path_, std::ios::binary);
  if (!file) {
    return State::kNone;
  }
  const std::string there{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return there == text_ ? State::kSame : State::kChanged;
}

Status Manifest::Write() const {
  return WriteWholeFile(path_, text_);
}

bool Manifest::IsDone(const std::string& path) const {
  std::error_code error;
  const auto made = fs::last_write_time(path, error);
  if (error) {
    return false;
  }
  const auto since = fs::last_write_time(path_, error);
  return !error && made >= since;
}

}  // namespace fovea::exports

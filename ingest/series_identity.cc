#include <filesystem>
#include <set>
#include <utility>

#include "ingest/given.h"
#include "ingest/payload.h"
#include "ingest/protocol.h"

namespace fovea::ingest {
namespace {

std::string FileName(const std::string& path) {
  return std::filesystem::path(path).filename().string();
}

}  // namespace

std::string IdentityOf(const std::string& text) {
  uint64_t hash = 14695981039346656037ULL;  // FNV-1a, 64 bits
  for (const char c : text) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
  }
  return fmt::format("{:016x}", hash);
}

std::string SeriesIdentity(const std::vector<ScannedFile>& files, const SeriesPlan& plan) {
  PayloadWriter text;
  for (const ScannedFile& file : files) {
    text.Text(FileName(file.file.path)).Text(Encode(file.info).payload);
    text.Number(static_cast<uint8_t>(file.file.held));
  }
  for (const std::string& field : plan.fields) {
    text.Text(field);
  }
  for (const PlannedStep& step : plan.steps) {
    text.Number(step.time_ns).Number(static_cast<uint8_t>(step.frame_number.has_value()));
    text.Number(step.frame_number.value_or(0));
    for (const FieldSource& source : step.sources) {
      text.Text(FileName(source.path)).Text(source.grid).Number(source.step_in_file);
    }
  }
  return IdentityOf(text.Take());
}

uint64_t InputBytes(const std::vector<ScannedFile>& files, const SeriesPlan& plan) {
  std::set<std::pair<std::string, int64_t>> read;  // a file that is held is there twice
  for (const PlannedStep& step : plan.steps) {
    for (const FieldSource& source : step.sources) {
      read.emplace(source.path, files[source.file_set].info.file_bytes);
    }
  }
  uint64_t bytes = 0;
  for (const auto& [path, file_bytes] : read) {
    bytes += static_cast<uint64_t>(file_bytes);
  }
  return bytes;
}

}  // namespace fovea::ingest

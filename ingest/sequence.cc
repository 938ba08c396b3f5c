#include "ingest/sequence.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <glob.h>

#include "ingest/file_format.h"
#include "ingest/name_pattern.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxSteps = 1'000'000;

/// A regular file, or a folder; whether it is a folder.
StatusOr<bool> CheckInput(const std::string& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::not_found) {
    return NotFound("there is no file '{}'", path);
  }
  if (error) {
    return NotFound("cannot look at '{}': {}", path, error.message());
  }
  if (!fs::is_directory(status) && !fs::is_regular_file(status)) {
    return InvalidArgument("'{}' is not a regular file", path);
  }
  return fs::is_directory(status);
}

/// "the folder holds 3 other files, e.g. 'a.vdb'", to help with a pattern that fits nothing.
std::string DescribeFolder(const std::vector<std::string>& names) {
  if (names.empty()) {
    return "the folder is empty";
  }
  return fmt::format("the folder holds {} other {}, e.g. '{}'", names.size(),
                     names.size() == 1 ? "file" : "files", names.front());
}

StatusOr<std::vector<SequenceFile>> ExpandPattern(const std::string& input,
                                                  const NamePattern& pattern) {
  const fs::path parent = fs::path(input).parent_path();
  const fs::path folder = parent.empty() ? fs::path(".") : parent;
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) {
    return NotFound("no files for '{}': cannot list folder '{}': {}", input, folder.string(),
                    error.message());
  }
  std::vector<SequenceFile> found;
  std::vector<std::string> others;
  for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
    const std::string name = entries->path().filename().string();
    if (const std::optional<int64_t> number = pattern.Match(name)) {
      found.push_back({(parent / name).string(), number, false, {}});
    } else {
      others.push_back(name);
    }
  }
  if (error) {
    return NotFound("cannot list folder '{}': {}", folder.string(), error.message());
  }
  if (found.empty()) {
    std::sort(others.begin(), others.end(), NaturalLess);
    return NotFound("no file matches '{}': looked for {} in '{}'; {}", input, pattern.Describe(),
                    folder.string(), DescribeFolder(others));
  }
  return found;
}

StatusOr<std::vector<SequenceFile>> ExpandGlob(const std::string& input) {
  glob_t matches{};
  const int result = ::glob(input.c_str(), GLOB_ERR, nullptr, &matches);
  std::vector<std::string> paths;
  for (size_t i = 0; result == 0 && i < matches.gl_pathc; ++i) {
    paths.emplace_back(matches.gl_pathv[i]);
  }
  ::globfree(&matches);
  if (result == GLOB_NOMATCH || (result == 0 && paths.empty())) {
    const fs::path parent = fs::path(input).parent_path();
    return NotFound("no file matches '{}' (looked in '{}')", input,
                    parent.empty() ? "." : parent.string());
  }
  if (result != 0) {
    return NotFound("cannot list the files of '{}': a folder on the way cannot be read", input);
  }
  std::sort(paths.begin(), paths.end(), NaturalLess);
  std::vector<SequenceFile> found;
  found.reserve(paths.size());
  for (std::string& path : paths) {
    found.push_back({std::move(path), std::nullopt, false, {}});
  }
  return found;
}

StatusOr<std::vector<SequenceFile>> ExpandInput(const std::string& input) {
  if (input.empty()) {
    return InvalidArgument("an input file name is empty");
  }
  std::error_code error;
  if (fs::exists(input, error)) {
    const size_t end = input.find_last_not_of('/');  // of a folder's name
    return std::vector<SequenceFile>{
        {end == std::string::npos ? input : input.substr(0, end + 1), std::nullopt, false, {}}};
  }
  FOVEA_ASSIGN_OR_RETURN(const std::optional<NamePattern> pattern,
                         NamePattern::Parse(fs::path(input).filename().string()));
  if (pattern) {
    return ExpandPattern(input, *pattern);
  }
  if (input.find_first_of("*?[") != std::string::npos) {
    return ExpandGlob(input);
  }
  return NotFound(
      "there is no file '{}' (a series is named with its numbers as ####, e.g. 'smoke_####.vdb')",
      input);
}

std::string FileName(const SequenceFile& file) {
  return fs::path(file.path).filename().string();
}

/// A folder stands for the pictures in it, in natural order: the slices of one step.
Status OpenFolder(SequenceFile* folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entries(folder->path, error);
       !error && entries != fs::directory_iterator(); entries.increment(error)) {
    const std::string name = entries->path().filename().string();
    if (!name.starts_with('.') && FormatByName(name) == FileFormat::kPicture) {
      names.push_back(name);
    }
  }
  if (error) {
    return NotFound("cannot list folder '{}': {}", folder->path, error.message());
  }
  if (names.empty()) {
    return InvalidArgument(
        "'{}' is a folder without pictures: name the files in it, e.g. '{}/*.vdb'", folder->path,
        folder->path);
  }
  std::sort(names.begin(), names.end(), NaturalLess);
  const fs::path parent(folder->path);
  folder->path = (parent / names.front()).string();
  for (size_t i = 1; i < names.size(); ++i) {
    folder->further.push_back((parent / names[i]).string());
  }
  return absl::OkStatus();
}

/// Folders become the pictures in them; pictures named one by one are the slices of one set.
StatusOr<std::vector<SequenceFile>> GatherSlices(std::vector<SequenceFile> files, bool folders) {
  if (folders) {
    for (SequenceFile& file : files) {
      FOVEA_RETURN_IF_ERROR(OpenFolder(&file));
    }
    return files;
  }
  const auto is_picture = [](const SequenceFile& file) {
    return FormatByName(file.path) == FileFormat::kPicture;
  };
  if (files.size() < 2 || !std::all_of(files.begin(), files.end(), is_picture)) {
    return files;
  }
  SequenceFile stack{files.front().path, std::nullopt, false, {}};
  for (size_t i = 1; i < files.size(); ++i) {
    stack.further.push_back(files[i].path);
  }
  return std::vector<SequenceFile>{std::move(stack)};
}

/// Headerless voxels may have a sidecar, which is no file of the series.
void AttachSidecars(std::vector<SequenceFile>* files) {
  std::set<std::string> sidecars;
  for (SequenceFile& file : *files) {
    const FileFormat format = FormatByName(file.path);
    const std::string sidecar = SidecarOf(file.path);
    std::error_code error;
    if ((format == FileFormat::kRaw || format == FileFormat::kUnknown) &&
        fs::is_regular_file(sidecar, error)) {
      file.further = {sidecar};
      sidecars.insert(sidecar);
    }
  }
  std::erase_if(*files, [&](const SequenceFile& file) { return sidecars.contains(file.path); });
}

/// Numbers for files that no pattern numbered: from the last run of digits that differs.
void NumberByNames(std::vector<SequenceFile>* files) {
  std::vector<std::string> names;
  names.reserve(files->size());
  for (const SequenceFile& file : *files) {
    names.push_back(FileName(file));
  }
  const std::vector<int64_t> numbers = NumbersThatDiffer(names);
  for (size_t i = 0; i < files->size(); ++i) {
    (*files)[i].frame_number = numbers.empty() ? std::nullopt : std::optional<int64_t>(numbers[i]);
  }
}

/// The file name of `number` beside `neighbour`.
std::string MissingName(const SequenceFile& neighbour, int64_t number) {
  const fs::path path(neighbour.path);
  return (path.parent_path() /
          WithNumber(path.filename().string(), *neighbour.frame_number, number))
      .string();
}

StatusOr<std::vector<SequenceFile>> FillGaps(std::vector<SequenceFile> files,
                                             OnMissing on_missing) {
  int64_t stride = 0;
  for (size_t i = 1; i < files.size(); ++i) {
    const int64_t difference = *files[i].frame_number - *files[i - 1].frame_number;
    if (difference == 0) {
      return InvalidArgument("'{}' and '{}' have the same number, {}", files[i - 1].path,
                             files[i].path, *files[i].frame_number);
    }
    stride = stride == 0 ? difference : std::min(stride, difference);
  }
  std::vector<SequenceFile> filled;
  for (const SequenceFile& file : files) {
    while (!filled.empty() && *file.frame_number - *filled.back().frame_number > stride) {
      const int64_t missing = *filled.back().frame_number + stride;
      if (on_missing == OnMissing::kSkip) {
        break;
      }
      if (on_missing == OnMissing::kError) {
        return NotFound(
            "there is no file '{}' between '{}' and '{}' (leave it out with "
            "--on-missing skip, or let the step before stand in with --on-missing hold)",
            MissingName(filled.back(), missing), filled.back().path, file.path);
      }
      if (filled.size() >= kMaxSteps) {
        return InvalidArgument("holding the gap before '{}' would make over {} steps", file.path,
                               kMaxSteps);
      }
      filled.push_back({filled.back().path, missing, true, filled.back().further});
    }
    filled.push_back(file);
  }
  return filled;
}

}  // namespace

std::vector<std::string> SequenceFile::Paths() const {
  std::vector<std::string> paths{path};
  paths.insert(paths.end(), further.begin(), further.end());
  return paths;
}

StatusOr<std::vector<SequenceFile>> ResolveInputs(const std::vector<std::string>& inputs,
                                                  OnMissing on_missing) {
  if (inputs.empty()) {
    return InvalidArgument("no input files were named");
  }
  std::vector<SequenceFile> files;
  for (const std::string& input : inputs) {
    FOVEA_ASSIGN_OR_RETURN(const std::vector<SequenceFile> found, ExpandInput(input));
    files.insert(files.end(), found.begin(), found.end());
  }
  if (files.size() > kMaxSteps) {
    return InvalidArgument("{} files; a series holds at most {}", files.size(), kMaxSteps);
  }
  AttachSidecars(&files);
  std::set<std::string> seen;
  bool folders = false;
  for (const SequenceFile& file : files) {
    FOVEA_ASSIGN_OR_RETURN(const bool is_folder, CheckInput(file.path));
    if (&file != &files.front() && is_folder != folders) {
      return InvalidArgument("'{}' is a folder and '{}' a file: name the one or the other",
                             is_folder ? file.path : files.front().path,
                             is_folder ? files.front().path : file.path);
    }
    folders = is_folder;
    if (!seen.insert(fs::path(file.path).lexically_normal().string()).second) {
      return InvalidArgument("'{}' is named twice", file.path);
    }
  }
  const auto is_numbered = [](const SequenceFile& f) { return f.frame_number.has_value(); };
  if (!std::all_of(files.begin(), files.end(), is_numbered)) {
    NumberByNames(&files);
  }
  if (std::all_of(files.begin(), files.end(), is_numbered)) {
    std::stable_sort(files.begin(), files.end(), [](const SequenceFile& a, const SequenceFile& b) {
      return *a.frame_number < *b.frame_number;
    });
    FOVEA_ASSIGN_OR_RETURN(files, FillGaps(std::move(files), on_missing));
  }
  return GatherSlices(std::move(files), folders);
}

}  // namespace fovea::ingest

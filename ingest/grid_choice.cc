#include "ingest/grid_choice.h"

#include <algorithm>
#include <map>
#include <set>
#include <string_view>

#include <absl/strings/str_join.h>

namespace fovea::ingest {
namespace {

constexpr size_t kMaxFieldName = 100;

/// "density" of "density[1]"; `index` gets "1", or nothing.
std::string PlainName(const std::string& grid, std::string* index = nullptr) {
  const size_t open = grid.rfind('[');
  if (open == std::string::npos || grid.back() != ']' || open + 2 >= grid.size() ||
      grid.find_first_not_of("0123456789", open + 1) != grid.size() - 1) {
    return grid;
  }
  if (index != nullptr) {
    *index = grid.substr(open + 1, grid.size() - open - 2);
  }
  return grid.substr(0, open);
}

/// "density (float), velocity (vec3s)": all grids of the series.
std::string ListGrids(const std::vector<ScannedFile>& files) {
  constexpr size_t kMaxListed = 20;
  std::vector<std::string> seen;
  for (const ScannedFile& file : files) {
    for (const GridInfo& grid : file.grids) {
      if (grid.on_request) {
        continue;  // its vector grid is listed
      }
      std::string text = fmt::format("{} ({})", Printable(grid.name), grid.type);
      if (std::find(seen.begin(), seen.end(), text) == seen.end() && seen.size() < kMaxListed) {
        seen.push_back(std::move(text));
      }
    }
  }
  return seen.empty() ? "no grids at all" : absl::StrJoin(seen, ", ");
}

/// What to do where no grid can be taken as it is.
std::string AdviceFor(const std::vector<ScannedFile>& files) {
  std::string advice;
  for (const ScannedFile& file : files) {
    for (const GridInfo& grid : file.grids) {
      if (!grid.problem.empty() && advice.find(grid.problem) == std::string::npos) {
        advice += fmt::format("; '{}': {}", Printable(grid.name), grid.problem);
      }
    }
    if (!advice.empty()) {
      break;  // one file tells enough
    }
  }
  return advice;
}

Status CheckUnique(const std::vector<ScannedFile>& files) {
  for (const ScannedFile& file : files) {
    std::set<std::string> names;
    for (const GridInfo& grid : file.grids) {
      if (!names.insert(grid.name).second) {
        return InvalidArgument("{}: two grids are called '{}' and cannot be told apart",
                               file.file.path, Printable(grid.name));
      }
    }
  }
  return absl::OkStatus();
}

/// The grid of the series that was asked for as `name`: of a vector grid its length, with a
/// warning.
StatusOr<std::string> ResolveAsked(const std::string& name, const std::vector<ScannedFile>& files,
                                   std::vector<std::string>* warnings) {
  for (const ScannedFile& file : files) {
    const GridInfo* grid = FindGrid(file, name);
    if (grid != nullptr && !grid->problem.empty()) {
      const GridInfo* length = FindGrid(file, grid->name + ".magnitude");
      if (length != nullptr && length->on_request) {
        warnings->push_back(fmt::format(
            "grid '{}' holds vectors: their length was taken, '{}' (a component: --grid {}.x)",
            Printable(grid->name), Printable(length->name), Printable(grid->name)));
        return length->name;
      }
    }
    if (grid != nullptr && !grid->problem.empty()) {
      return InvalidArgument("{}: grid '{}' cannot be read: {}", file.file.path,
                             Printable(grid->name), grid->problem);
    }
    if (grid != nullptr) {
      return grid->name;
    }
    const auto is_called = [&](const GridInfo& g) { return PlainName(g.name) == name; };
    if (std::count_if(file.grids.begin(), file.grids.end(), is_called) > 1) {
      return InvalidArgument("{}: several grids are called '{}': ask for {}[0], {}[1] ...",
                             file.file.path, name, name, name);
    }
  }
  return NotFound("no file of the series has a grid '{}'; there are: {}", name, ListGrids(files));
}

StatusOr<GridChoice> ChooseAsked(const std::vector<std::string>& asked,
                                 const std::vector<ScannedFile>& files) {
  GridChoice choice;
  for (const std::string& name : asked) {
    FOVEA_ASSIGN_OR_RETURN(const std::string grid, ResolveAsked(name, files, &choice.warnings));
    choice.grids.push_back({grid, FieldNameOf(grid)});
  }
  return choice;
}

StatusOr<GridChoice> ChooseAll(const std::vector<ScannedFile>& files) {
  GridChoice choice;
  std::set<std::string> seen;
  std::set<std::string> left_out;
  for (const ScannedFile& file : files) {
    for (const GridInfo& grid : file.grids) {
      if (grid.on_request) {
        continue;
      }
      if (grid.problem.empty()) {
        if (seen.insert(grid.name).second) {
          choice.grids.push_back({grid.name, FieldNameOf(grid.name)});
        }
      } else if (left_out.insert(grid.name).second && !seen.contains(grid.name)) {
        choice.warnings.push_back(fmt::format("grid '{}' is left out: {} (first seen in '{}')",
                                              Printable(grid.name), grid.problem, file.file.path));
      }
    }
  }
  if (choice.grids.empty()) {
    return InvalidArgument("no scalar grid in any file of the series; there are: {}{}",
                           ListGrids(files), AdviceFor(files));
  }
  return choice;
}

}  // namespace

std::string FieldNameOf(const std::string& grid) {
  constexpr std::string_view kAllowed =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-";
  std::string index;
  std::string field = PlainName(grid, &index).substr(0, kMaxFieldName);
  for (char& c : field) {
    c = kAllowed.find(c) == std::string_view::npos ? '_' : c;
  }
  if (field.empty()) {
    field = "unnamed";
  }
  if (field.front() == '.') {
    field.front() = '_';
  }
  if (!index.empty()) {
    field += "." + index;
  }
  // The store's own arrays.
  return field == "time" || field == "frame_number" ? field + "_" : field;
}

const GridInfo* FindGrid(const ScannedFile& file, const std::string& name) {
  const auto unique = [&](const auto& matches) -> const GridInfo* {
    const auto found = std::find_if(file.grids.begin(), file.grids.end(), matches);
    if (found == file.grids.end() || std::any_of(found + 1, file.grids.end(), matches)) {
      return nullptr;
    }
    return &*found;
  };
  if (const auto* grid = unique([&](const GridInfo& g) { return g.name == name; })) {
    return grid;
  }
  if (const auto* grid = unique([&](const GridInfo& g) { return FieldNameOf(g.name) == name; })) {
    return grid;
  }
  return unique([&](const GridInfo& g) { return PlainName(g.name) == name; });
}

StatusOr<GridChoice> ChooseGrids(const std::vector<std::string>& asked,
                                 const std::vector<ScannedFile>& files) {
  FOVEA_RETURN_IF_ERROR(CheckUnique(files));
  FOVEA_ASSIGN_OR_RETURN(GridChoice choice,
                         asked.empty() ? ChooseAll(files) : ChooseAsked(asked, files));
  std::map<std::string, std::string> grid_of;
  for (const ChosenGrid& chosen : choice.grids) {
    const auto [other, is_new] = grid_of.insert({chosen.field, chosen.grid});
    if (!is_new && other->second == chosen.grid) {
      return InvalidArgument("grid '{}' is asked for twice", Printable(chosen.grid));
    }
    if (!is_new) {
      return InvalidArgument("grids '{}' and '{}' would both become field '{}': choose one",
                             Printable(other->second), Printable(chosen.grid), chosen.field);
    }
    if (chosen.field != chosen.grid) {
      choice.warnings.push_back(
          fmt::format("grid '{}' becomes field '{}'", Printable(chosen.grid), chosen.field));
    }
  }
  return choice;
}

}  // namespace fovea::ingest

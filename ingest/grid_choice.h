#ifndef INGEST_GRID_CHOICE_H_
#define INGEST_GRID_CHOICE_H_

#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/protocol.h"
#include "ingest/sequence.h"

namespace fovea::ingest {

/// A file of the series with what its worker says about it.
struct ScannedFile {
  SequenceFile file;
  FileInfo info;
  std::vector<GridInfo> grids;
};

/// A grid (its unique name in the files) and the field of the store that it becomes.
struct ChosenGrid {
  std::string grid;
  std::string field;
  friend bool operator==(const ChosenGrid&, const ChosenGrid&) = default;
};

struct GridChoice {
  std::vector<ChosenGrid> grids;
  std::vector<std::string> warnings;
};

/// The field name of a grid: "density[1]" becomes density.1, what may not be in a field name
/// becomes '_'.
[[nodiscard]] std::string FieldNameOf(const std::string& grid);

/// The grid called `name` in a file: by its unique name, by its field name, or by its plain name if
/// no other grid of the file has that. Null if there is none.
[[nodiscard]] const GridInfo* FindGrid(const ScannedFile& file, const std::string& name);

/// Which grids of the series become fields: those asked for, in that order, or else every scalar
/// grid of any file in the order in which they first appear; others are left out with a warning.
/// A vector grid that is asked for by its name is taken as its length.
/// Errors name file and grid: asked for but in no file, or not readable, or not to be told apart.
[[nodiscard]] StatusOr<GridChoice> ChooseGrids(const std::vector<std::string>& asked,
                                               const std::vector<ScannedFile>& files);

}  // namespace fovea::ingest

#endif  // INGEST_GRID_CHOICE_H_

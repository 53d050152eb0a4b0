// SPDX-License-Identifier: Apache-2.0
// Reading SOG version 2, as specified by PlayCanvas ("The SOG Format", developer.playcanvas.com): a
// meta.json, and images whose pixel i belongs to splat i. Axes: as 3DGS PLY.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "interchange/named_files.h"
#include "interchange/sog_layout.h"

namespace stgs {

// A model whose description has been read.
struct SogModel {
  std::unique_ptr<NamedFiles> files;
  SogLayout layout;
};

// Reads the description of a model. Checks the sizes of its images without decoding them; allocates
// no memory for splats.
Result<SogModel> open_sog(std::unique_ptr<NamedFiles> files, const std::string& meta_name,
                          ImportMemory& memory);
// Reads models in the given order, as one static set.
Result<Scene> read_sog_models(const std::vector<SogModel>& models, ImportMemory& memory,
                              ConversionNotes* notes);

}  // namespace stgs

/* SPDX-License-Identifier: Apache-2.0 */
/* The header is self-contained and can be included twice. */
#include "stgs/stgs_player.h"

#include "stgs/stgs_player.h"

stgs_scene* call_player_from_c(stgs_player* player);
stgs_scene* call_player_from_c(stgs_player* player) {
  return stgs_player_scene(player);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The header needs nothing before it, and may be there twice. */
#include "stgs/stgs_player.h"

#include "stgs/stgs_player.h"

stgs_scene* scene_of_player(stgs_player* player);
stgs_scene* scene_of_player(stgs_player* player) {
  return stgs_player_scene(player);
}

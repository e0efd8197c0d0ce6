//! The maps of a study while it runs: none is built twice.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use anyhow::{Context, Result, anyhow};

use crate::recipe::map::MapRecipe;
use crate::trial::division::{Division, StudyData};
use crate::trial::map::{Dimension, StudyMap, build};

/// A map, or why it could not be built, once a thread has tried.
type Slot<const D: usize> = Arc<OnceLock<Result<Arc<StudyMap<D>>, String>>>;

/// Maps by the identity of their recipes, kept as long as a pending trial needs them.
pub struct Maps<'a, const D: usize> {
    data: &'a StudyData,
    slots: Mutex<HashMap<String, (Slot<D>, usize)>>,
}

impl<'a, const D: usize> Maps<'a, D>
where
    Division<D>: Dimension<D>,
{
    /// Maps for these recipes, each of which will be [released](Self::release) once.
    ///
    /// # Errors
    /// When the identity of a recipe cannot be computed.
    pub fn new<'r>(
        data: &'a StudyData,
        recipes: impl IntoIterator<Item = &'r MapRecipe>,
    ) -> Result<Self> {
        let mut slots: HashMap<String, (Slot<D>, usize)> = HashMap::new();
        for recipe in recipes {
            for identity in needed(recipe)? {
                slots.entry(identity).or_default().1 += 1;
            }
        }
        Ok(Maps { data, slots: Mutex::new(slots) })
    }

    /// The map of a recipe. While one thread builds it, others that want the same wait.
    ///
    /// # Errors
    /// When it cannot be built of this data.
    pub fn get(&self, recipe: &MapRecipe) -> Result<Arc<StudyMap<D>>> {
        let slot = {
            let mut slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
            match slots.get_mut(&recipe.identity()?) {
                Some((slot, _)) => slot.clone(),
                // No other trial needs it.
                None => Slot::default(),
            }
        };
        let built = slot
            .get_or_init(|| self.build(recipe).map(Arc::new).map_err(|error| format!("{error:#}")));
        built.clone().map_err(|reason| anyhow!(reason))
    }

    fn build(&self, recipe: &MapRecipe) -> Result<StudyMap<D>> {
        let division = self.division(recipe)?;
        build(recipe, &division, self.data, |initial| self.get(initial))
    }

    /// The division of the data that the map of a recipe is built from.
    ///
    /// # Errors
    /// When the data cannot be divided like that.
    pub fn division(&self, recipe: &MapRecipe) -> Result<Arc<Division<D>>> {
        let divided = self.data.divided(recipe.split, recipe.fold())?;
        Division::of(&divided).cloned().with_context(|| recipe.dataset.clone())
    }

    /// Reports that a trial no longer needs the map of a recipe.
    ///
    /// # Errors
    /// When the identity of the recipe cannot be computed.
    pub fn release(&self, recipe: &MapRecipe) -> Result<()> {
        let mut slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        for identity in needed(recipe)? {
            if let Some((_, uses)) = slots.get_mut(&identity) {
                *uses -= 1;
                if *uses == 0 {
                    slots.remove(&identity);
                }
            }
        }
        Ok(())
    }
}

/// Identities of the maps needed to build the map of a recipe.
fn needed(recipe: &MapRecipe) -> Result<Vec<String>> {
    let mut identities = vec![recipe.identity()?];
    let initial = recipe.initial().identity()?;
    if initial != identities[0] {
        identities.push(initial);
    }
    Ok(identities)
}

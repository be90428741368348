"""What effects and free-form terms change in the predictions, to first order."""

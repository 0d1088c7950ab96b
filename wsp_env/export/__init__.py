"""C99 and FMUs of what lies below: contact laws, controllers, policies, the longitudinal plant."""

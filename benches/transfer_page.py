def write_page(*a):
    print(a)
